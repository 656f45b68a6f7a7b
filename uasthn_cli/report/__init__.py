"""Summaries of finished runs, comparisons with truth, and gates."""
