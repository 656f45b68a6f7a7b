"""Pairs of satellite and thermal images with known corners, from several sources."""
