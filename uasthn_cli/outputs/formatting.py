"""How values are written: fixed decimals, UTC times, names that any file can hold."""

import math
from datetime import UTC, datetime, timedelta
from typing import Final

from uasthn_cli.types import FrameFailure, FrameFile, FrameResult, Prior

DEGREE_DECIMALS: Final = 8
METRE_DECIMALS: Final = 3
ANGLE_DECIMALS: Final = 3
SHARE_DECIMALS: Final = 4

_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


def fixed(value: float | None, decimals: int) -> str:
    """Return a number with fixed decimals; empty for None and for values that are not finite."""
    if value is None or not math.isfinite(value):
        return ""
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def finite_or_none(value: float | None, decimals: int) -> float | None:
    """Return a rounded number for JSON, which has no NaN; None where there is no number."""
    text = fixed(value, decimals)
    return float(text) if text else None


def iso_utc(time_utc_s: float | None) -> str:
    """Return seconds since 1970 as ISO 8601 with milliseconds and ``Z``; empty if undatable."""
    if time_utc_s is None or not math.isfinite(time_utc_s):
        return ""
    try:
        moment = _EPOCH + timedelta(milliseconds=round(time_utc_s * 1000.0))
    except OverflowError:
        return ""
    return moment.replace(tzinfo=None).isoformat(timespec="milliseconds") + "Z"


def safe_text(text: str) -> str:
    r"""Return text that UTF-8 can hold: undecodable bytes of file names as ``\udcXX``."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def frame_of(result: FrameResult) -> FrameFile:
    """Return the frame of a result."""
    return result.frame if isinstance(result, FrameFailure) else result.prior.frame


def time_of(result: FrameResult) -> float | None:
    """Return the capture time of a result in UTC seconds, where it is known."""
    if isinstance(result, FrameFailure) and result.time_utc_s is not None:
        return result.time_utc_s
    prior: Prior | None = result.prior
    return None if prior is None else prior.time_utc_s
