"""The least that geo-tagging takes: parse the log and decode every frame, nothing else.

python benchmarks/floor.py LOG FRAMES
"""

import sys
from pathlib import Path

from uasthn_cli.ingest.frames import UnreadableFrameError, list_frames, read_frame
from uasthn_cli.ingest.mavlink import read_telemetry


def main(log: str, frames: str) -> None:
    """Read a flight and keep nothing of it."""
    read_telemetry(Path(log))
    for frame in list_frames(Path(frames)):
        try:
            read_frame(frame.path)
        except UnreadableFrameError:
            continue  # geotag makes a row of it and goes on, too


if __name__ == "__main__":
    main(*sys.argv[1:])
