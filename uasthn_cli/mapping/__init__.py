"""The map and the frame on one grid: windows, feature tiles, rectified frames."""
