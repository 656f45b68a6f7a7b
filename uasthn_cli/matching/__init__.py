"""Estimators: where a rectified thermal frame lies in a map window."""
