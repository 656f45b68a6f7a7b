"""The whole flight: neighbouring frames share the log's error, so they settle each other."""
