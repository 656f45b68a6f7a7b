"""Workshop: from finished runs with known positions to a calibration file."""
