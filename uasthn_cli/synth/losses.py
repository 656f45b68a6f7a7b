"""What is missing: frames that were not stored, and camera messages that the log lost."""

from dataclasses import replace

import numpy as np

from uasthn_cli.synth.exposures import Exposure, Stream, random_stream
from uasthn_cli.synth.flight_config import FlightConfig

_FEWEST_DIGITS = 4


def frames_kept(config: FlightConfig, exposures: list[Exposure]) -> list[tuple[int, Exposure]]:
    """Return the exposures whose frames exist, each with its number among all, from 0.

    With ``renumber`` they are named in the order they were taken, from 1 and without gaps.
    """
    rng = random_stream(config, Stream.LOST_FRAMES)
    kept = _kept(rng, len(exposures), config.errors.lose_frames)
    if not config.errors.renumber:
        return [(index, exposures[index]) for index in kept]
    digits = max(_FEWEST_DIGITS, len(str(len(kept))))
    return [
        (index, replace(exposures[index], name=f"frame_{number:0{digits}}.png"))
        for number, index in enumerate(kept, start=1)
    ]


def messages_kept(config: FlightConfig, count: int) -> list[int]:
    """Return the numbers, from 0, of the exposures of which the log has a camera message."""
    if not config.camera_messages:
        return []
    return _kept(random_stream(config, Stream.LOST_MESSAGES), count, config.errors.lose_messages)


def _kept(rng: np.random.Generator, count: int, share: float) -> list[int]:
    """Return which of ``count`` remain in order when a share is lost at random; one at least."""
    lost = min(round(share * count), count - 1)
    gone = set(rng.permutation(count)[:lost].tolist())
    return [index for index in range(count) if index not in gone]
