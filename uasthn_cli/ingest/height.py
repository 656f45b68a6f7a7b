"""Height over ground: measured where the log measured it, else above the take-off point."""

import math
from dataclasses import dataclass

from uasthn_cli.geometry.camera import tilt_rad
from uasthn_cli.ingest.clock import Clock
from uasthn_cli.ingest.interpolate import (
    AmbiguousTimeError,
    OutsideLogError,
    Track,
    linear,
    make_track,
)
from uasthn_cli.ingest.telemetry import Telemetry
from uasthn_cli.types import Attitude

FIXED_SOURCE = "given"
_LOW_M = 10.0
_SANE_RATIO = 3.0
"""Above ``_LOW_M``, a height this many times off the logged one is a sensor out of range."""

MIN_HEIGHT_M = 1.0


@dataclass(frozen=True, slots=True)
class HeightSource:
    """One kind of measured height along the log."""

    name: str
    along_body_axis: bool
    track: Track

    def height_m(self, time_s: float, attitude: Attitude, max_gap_s: float) -> float | None:
        """Return the height over ground at an instant, None where it was not measured."""
        try:
            value = float(linear(self.track.bracket(time_s, max_gap_s))[0])
        except (OutsideLogError, AmbiguousTimeError):
            return None
        return value * math.cos(tilt_rad(attitude)) if self.along_body_axis else value


def height_sources(telemetry: Telemetry, clock: Clock) -> tuple[HeightSource, ...]:
    """Return the measured heights of a log in order of preference."""
    return tuple(
        HeightSource(
            samples.source,
            samples.along_body_axis,
            make_track(samples.source, clock, samples.stamps, (samples.height_m,)),
        )
        for samples in telemetry.heights
    )


def measured_height(
    sources: tuple[HeightSource, ...],
    time_s: float,
    body: Attitude,
    above_start_m: float,
    max_gap_s: float,
) -> tuple[float, str] | None:
    """Return the first sane measured height over ground and its source, None if there is none.

    ``body`` is the vehicle's attitude: range sensors are fixed to it. ``above_start_m`` is the
    logged height above take-off, against which a measured one is checked.
    """
    for source in sources:
        height_m = source.height_m(time_s, body, max_gap_s)
        if height_m is not None and _is_sane(height_m, above_start_m):
            return height_m, source.name
    return None


def _is_sane(height_m: float, above_start_m: float) -> bool:
    """Tell whether a measured height is possible next to the height above take-off."""
    if height_m < MIN_HEIGHT_M:
        return False
    if above_start_m < _LOW_M:
        return True
    return above_start_m / _SANE_RATIO <= height_m <= above_start_m * _SANE_RATIO
