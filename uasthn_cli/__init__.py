"""Tell where a drone's thermal frames were taken when GPS cannot be trusted."""

__version__ = "0.2.0"
