"""Times written as text: in file names, in tables, in EXIF; durations as words."""

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone
from typing import Final

_EARLIEST_S = datetime(2000, 1, 1, tzinfo=UTC).timestamp()
_LATEST_S = datetime(2100, 1, 1, tzinfo=UTC).timestamp()

_EPOCH_UNITS: Final = ((1e11, 1.0), (1e14, 1e-3), (1e17, 1e-6), (1e20, 1e-9))
"""Numbers below the first count in the second: seconds, milli-, micro- and nanoseconds."""

_DATE_TIME: Final = re.compile(
    r"""(?<!\d)
    (?P<year>20\d\d) [-_.:/]? (?P<month>\d\d) [-_.:/]? (?P<day>\d\d)
    [T_\-.\ ]?
    (?P<hour>\d\d) [-_.:h]? (?P<minute>\d\d) [-_.:m]? (?P<second>\d\d)
    (?: [.,]? (?P<fraction>\d+) )?
    (?: \s? (?P<zone> Z | [+-]\d\d:\d\d | \+\d{4} ) )?
    (?!\d)""",
    re.VERBOSE | re.IGNORECASE,
)
_EPOCH: Final = re.compile(r"(?<![\d.])(\d{10}(?:[.]\d+)?|\d{13}|\d{16}|\d{19})(?!\d)")


@dataclass(frozen=True, slots=True)
class StatedTime:
    """A time as it was written: ``is_local`` marks one without zone, which is read as UTC."""

    time_s: float
    is_local: bool


def time_in_name(stem: str) -> StatedTime | None:
    """Return the time in a file's name (without folder and extension), or None.

    Understood: dates and times with or without separators, with decimals of the second
    (``2018080501004480Z`` is 44.80 s), with ``Z`` or an offset; seconds since 1970 with decimals,
    or with 13, 16, 19 digits for milli-, micro- and nanoseconds.
    """
    for match in _DATE_TIME.finditer(stem):
        found = _from_match(match)
        if found is not None:
            return found
    for match in _EPOCH.finditer(stem):
        time_s = _from_epoch(match[1])
        if time_s is not None:
            return StatedTime(time_s, is_local=False)
    return None


def parse_time(text: str) -> StatedTime | None:
    """Return the time a whole text states (ISO 8601, EXIF, or a number since 1970), or None."""
    text = text.strip()
    time_s = _from_epoch(text)
    if time_s is not None:
        return StatedTime(time_s, is_local=False)
    match = _DATE_TIME.fullmatch(text)
    if match is not None:
        return _from_match(match)
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return None
    return _stated(moment)


def duration_words(seconds: float) -> str:
    """Return a duration as people say it: a clock that is off by days shows at once."""
    for limit_s, unit_s, unit in ((300, 1, "s"), (7200, 60, "min"), (172_800, 3600, "h")):
        if seconds < limit_s:
            return f"{seconds / unit_s:.1f} {unit}"
    return f"{seconds / 86_400:.0f} days"


def _from_match(match: re.Match[str]) -> StatedTime | None:
    year, month, day, hour, minute, second = (
        int(match[name]) for name in ("year", "month", "day", "hour", "minute", "second")
    )
    try:
        moment = datetime(year, month, day, hour, minute, second, tzinfo=_zone(match["zone"]))
    except ValueError:
        return None
    fraction_s = float(f"0.{match['fraction']}") if match["fraction"] else 0.0
    whole = _stated(moment)
    return None if whole is None else StatedTime(whole.time_s + fraction_s, whole.is_local)


def _stated(moment: datetime) -> StatedTime | None:
    is_local = moment.tzinfo is None
    try:
        time_s = (moment.replace(tzinfo=UTC) if is_local else moment).timestamp()
    except (OverflowError, ValueError):
        return None
    return StatedTime(time_s, is_local) if _EARLIEST_S <= time_s < _LATEST_S else None


def _zone(text: str | None) -> timezone | None:
    """Return the zone of ``Z``, ``+02:00`` or ``+0200``; None for none."""
    if text is None:
        return None
    if text.upper() == "Z":
        return UTC
    sign = -1 if text[0] == "-" else 1
    hours, minutes = int(text[1:3]), int(text[-2:])
    return timezone(sign * timedelta(hours=hours, minutes=minutes))


def _from_epoch(text: str) -> float | None:
    """Return a number since 1970 in seconds if it lies in 2000..2100, its unit told by its size."""
    if re.fullmatch(r"\d+(?:\.\d+)?", text) is None:
        return None
    number = float(text)
    unit = next((unit for limit, unit in _EPOCH_UNITS if number < limit), None)
    if unit is None:
        return None
    time_s = number * unit
    return time_s if _EARLIEST_S <= time_s < _LATEST_S else None
