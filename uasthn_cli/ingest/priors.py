"""From log and frames to priors: where the log says each frame was taken, and how turned."""

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uasthn_cli.config import PriorConfig
from uasthn_cli.ingest.clock import Clock
from uasthn_cli.ingest.frame_times import (
    FrameTimes,
    in_zone_of_log,
    stated_times,
    with_camera_messages,
)
from uasthn_cli.ingest.gimbal import camera_attitude, gimbal_track
from uasthn_cli.ingest.height import (
    FIXED_SOURCE,
    MIN_HEIGHT_M,
    HeightSource,
    height_sources,
    measured_height,
)
from uasthn_cli.ingest.interpolate import (
    AmbiguousTimeError,
    OutsideLogError,
    Track,
    linear_position,
    make_track,
    slerp_attitude,
)
from uasthn_cli.ingest.telemetry import Telemetry
from uasthn_cli.ingest.timebase import (
    TimeBaseChoice,
    candidate_clocks,
    choose_time_base,
    log_spans_s,
)
from uasthn_cli.types import Attitude, FrameFailure, FrameFile, Prior, Reason

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class PriorSet:
    """Priors of a flight in the order of its frames, and on what they rest.

    ``height_source``, ``altitude_source`` and ``attitude_source`` name the log's fields; where
    frames differ, the commonest comes first and the others follow after commas.
    """

    results: list[Prior | FrameFailure]
    time_base: TimeBaseChoice
    frame_times: FrameTimes
    height_source: str
    altitude_source: str
    attitude_source: str


@dataclass(frozen=True, slots=True)
class _Tracks:
    """What can be looked up along the log."""

    positions: Track
    attitudes: Track
    gimbal: Track | None
    heights: tuple[HeightSource, ...]
    above_start_source: str


def build_priors(
    telemetry: Telemetry,
    frames: Sequence[FrameFile],
    *,
    config: PriorConfig,
    frame_times_csv: Path | None = None,
) -> PriorSet:
    """Look every frame up in the log.

    ``config.time_offset_s`` is added to a frame's time first. Worked example: a frame is named
    12:00:00 and shows what the log records at 12:00:02.5, because the camera's clock is 2.5 s slow;
    then the offset is +2.5 and the prior is dated 12:00:02.5.

    A frame without time, outside the log, or on the ground becomes a
    :class:`~uasthn_cli.types.FrameFailure`.

    Raises:
        FrameTimesError: no source dates the frames, or the asked-for clock is not in the log.
    """
    stated = stated_times(frames, frame_times_csv)
    hints = None
    if stated is not None:
        spans = [
            span for clock in candidate_clocks(telemetry) for span in log_spans_s(telemetry, clock)
        ]
        stated = in_zone_of_log(stated, spans, config.time_offset_s)
        hints = np.array(stated.known_s) + config.time_offset_s
    choice = choose_time_base(telemetry, config.time_base, hints)
    times = with_camera_messages(frames, telemetry, choice.clock, stated, config.pair_by)
    _log.info("frame times: %s", times.why)
    results = look_up(telemetry, frames, choice.clock, times, config)
    gimbal = telemetry.gimbal
    return PriorSet(
        results=results,
        time_base=choice,
        frame_times=times,
        height_source=commonest([r.height_source for r in results if isinstance(r, Prior)]),
        altitude_source=telemetry.positions.altitude_source,
        attitude_source="attitude" if gimbal is None else gimbal.message.lower(),
    )


def look_up(
    telemetry: Telemetry,
    frames: Sequence[FrameFile],
    clock: Clock,
    times: FrameTimes,
    config: PriorConfig,
) -> list[Prior | FrameFailure]:
    """Return what the log says of frames whose times are known, ``config.time_offset_s`` later."""
    tracks = _tracks(telemetry, clock)
    return [
        _result(frame, time_s, tracks, config)
        for frame, time_s in zip(frames, times.times_s, strict=True)
    ]


def _tracks(telemetry: Telemetry, clock: Clock) -> _Tracks:
    positions, attitudes = telemetry.positions, telemetry.attitudes
    place = (positions.lat_deg, positions.lon_deg, positions.height_m, positions.alt_amsl_m)
    angles = (attitudes.roll_rad, attitudes.pitch_rad, attitudes.yaw_rad)
    return _Tracks(
        positions=make_track("position", clock, positions.stamps, place),
        attitudes=make_track("attitude", clock, attitudes.stamps, angles),
        gimbal=None if telemetry.gimbal is None else gimbal_track(telemetry.gimbal, clock),
        heights=height_sources(telemetry, clock),
        above_start_source=positions.height_source,
    )


def _result(
    frame: FrameFile, time_s: float | None, tracks: _Tracks, config: PriorConfig
) -> Prior | FrameFailure:
    if time_s is None:
        return FrameFailure(frame, Reason.NO_TIME, "no capture time for this frame")
    time_s += config.time_offset_s
    gap_s = config.max_gap_s
    try:
        place = linear_position(tracks.positions.bracket(time_s, gap_s))
        body = slerp_attitude(tracks.attitudes.bracket(time_s, gap_s))
        camera = body
        if tracks.gimbal is not None:
            camera = camera_attitude(tracks.gimbal, time_s, gap_s, body)
    except OutsideLogError as error:
        return FrameFailure(frame, Reason.OUTSIDE_LOG, str(error), time_s)
    except AmbiguousTimeError as error:
        return FrameFailure(frame, Reason.NO_PRIOR, str(error), time_s)
    lat_deg, lon_deg, above_start_m, alt_amsl_m = place.tolist()
    height_m, source = _height(tracks, time_s, body, above_start_m, config)
    prior = Prior(
        frame, time_s, lat_deg, lon_deg, height_m, camera, source, alt_amsl_m, above_start_m
    )
    # over a valley frames may be below take-off: an elevation model has the last word
    is_low = height_m < MIN_HEIGHT_M and config.dem_path is None
    return on_the_ground(prior) if is_low else prior


def on_the_ground(prior: Prior) -> FrameFailure:
    """Return that a frame was not taken from the air."""
    height_m, source = prior.height_above_ground_m, prior.height_source
    detail = f"on the ground: {height_m:.1f} m above it by {source}"
    return FrameFailure(prior.frame, Reason.NO_PRIOR, detail, prior.time_utc_s)


def _height(
    tracks: _Tracks, time_s: float, body: Attitude, above_start_m: float, config: PriorConfig
) -> tuple[float, str]:
    if config.height_above_ground_m is not None:
        return config.height_above_ground_m, FIXED_SOURCE
    measured = measured_height(tracks.heights, time_s, body, above_start_m, config.max_gap_s)
    return measured or (above_start_m, tracks.above_start_source)


def commonest(names: Sequence[str]) -> str:
    """Return names by falling frequency, separated by commas; ``none`` for no name."""
    return ", ".join(name for name, _ in Counter(names).most_common()) or "none"
