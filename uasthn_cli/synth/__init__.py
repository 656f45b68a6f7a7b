"""Render flights with known truth: landscape, night view, trajectory, log."""
