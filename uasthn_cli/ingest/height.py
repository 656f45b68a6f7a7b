"""Height over ground: measured where the log measured it, else above the take-off point."""

import math
from dataclasses import dataclass

import numpy as np

from uasthn_cli.geometry.camera import tilt_rad
from uasthn_cli.ingest.clock import Clock
from uasthn_cli.ingest.interpolate import (
    AmbiguousTimeError,
    OutsideLogError,
    Track,
    linear,
    make_track,
)
from uasthn_cli.ingest.telemetry import ABOVE_FIRST_FIX, Telemetry
from uasthn_cli.types import Attitude

FIXED_SOURCE = "given"
ON_GROUND_M = 3.0
"""A log whose first height above take-off is less starts on the ground, at take-off."""

_LOW_M = 10.0
_SANE_RATIO = 3.0
"""Above ``_LOW_M``, a height this many times off the logged one is a sensor out of range."""

MIN_HEIGHT_M = 1.0


@dataclass(frozen=True, slots=True)
class Start:
    """Where the log first is nearest to the ground at take-off.

    ``height_m`` is that above take-off, ``ground_amsl_m`` what the log has for the altitude of
    take-off (NaN: nothing). ``is_assumed``: that its first fix is at take-off is an assumption.
    """

    lat_deg: float
    lon_deg: float
    height_m: float
    ground_amsl_m: float
    is_assumed: bool

    @property
    def is_on_ground(self) -> bool:
        """Tell whether this is the place of take-off."""
        return abs(self.height_m) <= ON_GROUND_M


def start_of(telemetry: Telemetry) -> Start:
    """Return where a log first is on the ground at take-off; its first position if it never is."""
    positions = telemetry.positions
    on_ground = np.abs(positions.height_m) <= ON_GROUND_M
    first = int(on_ground.argmax())
    return Start(
        lat_deg=float(positions.lat_deg[first]),
        lon_deg=float(positions.lon_deg[first]),
        height_m=float(positions.height_m[first]),
        ground_amsl_m=float(np.median(positions.alt_amsl_m - positions.height_m)),
        is_assumed=positions.height_source == ABOVE_FIRST_FIX,
    )


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
