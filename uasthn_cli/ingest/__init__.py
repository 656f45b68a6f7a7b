"""Read what was recorded: telemetry, clocks, frames, cameras, and the prior they give."""
