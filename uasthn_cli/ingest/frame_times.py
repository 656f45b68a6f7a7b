"""When each frame was exposed: from a table, the log's camera messages, names, or EXIF."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np

from uasthn_cli.config import PairBy
from uasthn_cli.errors import FrameTimesError
from uasthn_cli.ingest.camera_events import event_times_s
from uasthn_cli.ingest.clock import Clock
from uasthn_cli.ingest.exif import read_exif
from uasthn_cli.ingest.frame_table import read_frame_table
from uasthn_cli.ingest.pairing import LEAST_SHARE, Pairing, UnpairedError, pair_frames
from uasthn_cli.ingest.telemetry import CameraEvents, Telemetry
from uasthn_cli.ingest.timebase import Span, covered_share
from uasthn_cli.ingest.timestamps import StatedTime, time_in_name
from uasthn_cli.types import FloatArray, FrameFile

_log = logging.getLogger(__name__)

_MIN_SHARE = 0.5
"""A source is believed if it dates at least this share of the frames."""

_TELLING_SHARE = 0.25
"""A time zone is inferred if it brings at least this share of the frames more into the log."""

_ZONES_H: Final = (
    *range(-12, 15), -9.5, -3.5, 3.5, 4.5, 5.5, 5.75, 6.5, 8.75, 9.5, 10.5, 12.75,
)  # fmt: skip
"""Offsets from UTC in use (IANA time zone database)."""


@dataclass(frozen=True, slots=True)
class FrameTimes:
    """Capture times of ``n`` frames in UTC seconds, None where unknown.

    ``source`` is ``table``, a camera message's name, ``name`` or ``exif``; ``why`` says in
    words how many frames it dates. ``is_local`` marks times that were stated without a time zone.
    ``pairing`` tells, where times are those of camera messages, which of these each frame has.
    """

    times_s: tuple[float | None, ...]
    source: str
    why: str
    is_local: bool = False
    pairing: Pairing | None = None

    @property
    def known_s(self) -> list[float]:
        """Return the times that are known."""
        return [time_s for time_s in self.times_s if time_s is not None]


def stated_times(frames: Sequence[FrameFile], csv: Path | None) -> FrameTimes | None:
    """Return times that come with the frames: from a table, else their names, else EXIF.

    Raises:
        FrameTimesError: the table cannot be used.
    """
    if csv is not None:
        table = read_frame_table(csv)
        found = _gather(frames, lambda frame: _look_up(table, frame), "table", f"table {csv.name}")
        if not found.known_s:
            raise FrameTimesError(
                f"{csv} names none of the {len(frames)} frames; its first column of names must hold"
                f" file names such as {frames[0].name}"
            )
        return found
    by_name = _gather(frames, _from_name, "name", "file names")
    if len(by_name.known_s) >= _MIN_SHARE * len(frames):
        return by_name
    by_exif = _gather(frames, lambda frame: read_exif(frame.path).taken, "exif", "EXIF")
    best = max(by_exif, by_name, key=lambda found: len(found.known_s))
    return best if best.known_s else None


def frame_times(
    frames: Sequence[FrameFile],
    telemetry: Telemetry,
    clock: Clock,
    csv: Path | None,
    pair_by: PairBy = PairBy.AUTO,
) -> FrameTimes:
    """Return capture times of frames, from the best source there is.

    In order: the table ``csv``; camera messages of the log, dated by ``clock`` and paired by
    ``pair_by``; times in file names; EXIF ``DateTimeOriginal``.

    Raises:
        FrameTimesError: no source dates the frames, the table cannot be used, or frames and camera
            messages may be paired in several ways.
    """
    return with_camera_messages(frames, telemetry, clock, stated_times(frames, csv), pair_by)


def with_camera_messages(
    frames: Sequence[FrameFile],
    telemetry: Telemetry,
    clock: Clock,
    stated: FrameTimes | None,
    pair_by: PairBy = PairBy.AUTO,
) -> FrameTimes:
    """Return ``stated`` times, or those of the log's camera messages where these come first.

    Raises:
        FrameTimesError: there is neither, or the messages may be paired in several ways.
    """
    if stated is not None and stated.source == "table":
        return stated
    if pair_by is not PairBy.NONE:
        from_log = _from_events(frames, telemetry, clock, stated, pair_by)
        if from_log is not None:
            return from_log
    if stated is not None:
        return _without_messages(stated, telemetry, pair_by)
    events = sum(len(events.stamps) for events in telemetry.camera_events)
    held = f"{events} camera messages that fit no frame" if events else "no camera message"
    raise FrameTimesError(
        f"no capture time for the {len(frames)} frames: the log holds {held}, and neither file"
        f" names (such as {frames[0].name}) nor EXIF tell one; give --frame-times FILE.csv with"
        " the columns frame,time, or rename the frames to their UTC time"
        " (20180805T010044.80Z.png), or log CAMERA_FEEDBACK"
    )


def in_zone_of_log(stated: FrameTimes, spans: Sequence[Span], offset_s: float = 0.0) -> FrameTimes:
    """Move times stated without a zone by the zone by which they fall into the log, if one does.

    ``spans`` are first and last times of the log by either clock; ``offset_s`` will be added to
    the frames' times later.
    """
    known_s = np.array(stated.known_s) + offset_s
    if not stated.is_local or not len(known_s):
        return stated
    zones = sorted(_ZONES_H, key=abs)
    shares = [covered_share(known_s - zone_h * 3600.0, spans) for zone_h in zones]
    as_utc = shares[zones.index(0)]
    if max(shares) < _MIN_SHARE or max(shares) - as_utc < _TELLING_SHARE:
        return stated
    zone_h = zones[int(np.argmax(shares))]
    _log.warning(
        "frame times are read as local time of UTC%+g h: so they fall into the log", zone_h
    )
    return replace(
        stated,
        times_s=tuple(None if t is None else t - zone_h * 3600.0 for t in stated.times_s),
        why=f"{stated.why}, read as local time UTC{zone_h:+g} h to fall into the log",
    )


def _gather(
    frames: Sequence[FrameFile],
    look_up: Callable[[FrameFile], StatedTime | None],
    source: str,
    words: str,
) -> FrameTimes:
    found = [look_up(frame) for frame in frames]
    known = [stated for stated in found if stated is not None]
    return FrameTimes(
        times_s=tuple(None if stated is None else stated.time_s for stated in found),
        source=source,
        why=f"times of {len(known)} of {len(frames)} frames from {words}",
        is_local=bool(known) and all(stated.is_local for stated in known),
    )


def _from_name(frame: FrameFile) -> StatedTime | None:
    return time_in_name(PurePosixPath(frame.name).stem)


def _look_up(table: dict[str, StatedTime], frame: FrameFile) -> StatedTime | None:
    """Find a frame by its name with folders, without folders, or without extension."""
    path = PurePosixPath(frame.name.casefold())
    keys = (path.as_posix(), path.name, path.stem)
    return next((table[key] for key in keys if key in table), None)


def _from_events(
    frames: Sequence[FrameFile],
    telemetry: Telemetry,
    clock: Clock,
    stated: FrameTimes | None,
    pair_by: PairBy,
) -> FrameTimes | None:
    """Return times of the camera message that fits most frames, None if none fits half of them.

    Raises:
        FrameTimesError: messages there are, but none that is clearly the frames'.
    """
    hints_s = np.full(len(frames), np.nan)
    if stated is not None:
        hints_s = np.array([np.nan if t is None else t for t in stated.times_s])
    found: list[tuple[int, FrameTimes]] = []
    refused: list[str] = []
    for events in telemetry.camera_events:
        event_s = event_times_s(events, clock)
        try:
            pairing = pair_frames(frames, hints_s, events, event_s, pair_by)
        except UnpairedError as error:
            refused.append(f"{len(events.stamps)} {events.message}: {error}")
            continue
        if pairing is not None and pairing.paired >= LEAST_SHARE * len(frames):
            found.append((pairing.paired, _dated_by_events(events, event_s, hints_s, pairing)))
    if found:
        return max(found, key=lambda entry: entry[0])[1]
    if refused:
        raise FrameTimesError(
            f"frames and the log's camera messages cannot be paired ({'; '.join(refused)}); say"
            " which evidence to believe with --pair-by name|time|number|order, leave the messages"
            " alone with --pair-by none, or give --frame-times FILE.csv"
        )
    return None


def _without_messages(stated: FrameTimes, telemetry: Telemetry, pair_by: PairBy) -> FrameTimes:
    """Return the frames' own times, and why camera messages are not used where there are any."""
    messages = sum(len(events.stamps) for events in telemetry.camera_events)
    if not messages:
        return stated
    asked = pair_by is PairBy.NONE
    reason = "as asked" if asked else "fewer than half of the frames have one"
    why = f"{stated.why}; the log's {messages} camera messages are left alone: {reason}"
    if not asked:
        _log.warning("frame times: %s", why)
    return replace(stated, why=why)


def _dated_by_events(
    events: CameraEvents, event_s: FloatArray, hints_s: FloatArray, pairing: Pairing
) -> FrameTimes:
    """Return the times of a pairing.

    A frame whose message was lost is dated by its own clock, set by the others' messages.
    """
    paired = pairing.index >= 0
    times_s = np.where(paired, event_s[pairing.index], np.nan)
    ahead_s = times_s - hints_s
    if np.isfinite(ahead_s).any():
        own_s = hints_s + np.nanmedian(ahead_s)
        if pairing.shift_s is not None and pairing.drift is not None:
            own_s = hints_s + pairing.shift_s + pairing.drift * (hints_s - np.nanmin(hints_s))
        times_s = np.where(paired, times_s, own_s)
    carried = int(np.isfinite(times_s).sum()) - pairing.paired
    rest = f", {carried} more by their own clock set by these" if carried else ""
    unused = pairing.messages - pairing.paired
    return FrameTimes(
        times_s=tuple(float(t) if np.isfinite(t) else None for t in times_s),
        source=events.message.lower(),
        why=f"times of {pairing.paired} of {len(times_s)} frames from the log's"
        f" {pairing.messages} {events.message} messages, paired {pairing.why}{rest};"
        f" {unused} of these messages have no frame",
        pairing=pairing,
    )
