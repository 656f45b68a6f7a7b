"""One row of ``frames.csv``, as far as a report needs it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Self

from uasthn_cli.errors import ResultsError

SINGLE_PREFIX: Final = "single_"
"""Before the columns of the single-frame answer, in a run whose answers were fused over frames."""

Cells = Mapping[str, str | None]

_ACCEPTED: Final = {"true": True, "false": False}
_EVIDENCE_OF_AN_ESTIMATE: Final = ("lat", "ce_m", "confidence")


@dataclass(frozen=True, slots=True)
class FrameRow:
    """An answer to where a frame was, and what it was said to be worth; NaN where that is unknown.

    ``detail`` says of a rejected one what was missing. ``ce_m`` and ``mace_m`` compare the estimate
    with truth, ``prior_ce_m`` the prior's camera position with the true one, ``camera_ce_m`` the
    estimate's. ``risk`` is the predicted probability that CE exceeds the tolerance, ``ce90_m`` the
    predicted 90 % radius, ``camera_ce90_m`` that of the camera. ``single`` is the answer of the
    frame alone, where the row's own is fused from several frames.
    """

    frame: str
    has_estimate: bool
    has_prior: bool
    accepted: bool
    reason: str
    ce_m: float
    mace_m: float
    prior_ce_m: float
    detail: str = ""
    source: str = ""
    confidence: float = math.nan
    entropy: float = math.nan
    sigma_m: float = math.nan
    u_m: float = math.nan
    agreement_m: float = math.nan
    support: float = math.nan
    risk: float = math.nan
    ce90_m: float = math.nan
    camera_ce_m: float = math.nan
    camera_ce90_m: float = math.nan
    single: Self | None = None


def parse_row(cells: Cells, where: str) -> FrameRow:
    """Read one row; ``where`` names file and line in errors.

    Raises:
        ResultsError: a cell is not what its column holds.
    """
    has_single = f"{SINGLE_PREFIX}accepted" in cells
    single = _answer(cells, SINGLE_PREFIX, where, None) if has_single else None
    return _answer(cells, "", where, single)


def _answer(cells: Cells, prefix: str, where: str, single: FrameRow | None) -> FrameRow:
    """Read the answer whose columns start with ``prefix``."""

    def number(column: str) -> float:
        return _number(cells, prefix + column, where)

    return FrameRow(
        frame=cells["frame"] or "",
        has_estimate=_has_estimate(cells, prefix),
        has_prior=bool(cells["prior_lat"] and cells["prior_lon"]),
        accepted=_is_accepted(cells, prefix, where),
        reason=cells.get(f"{prefix}reason") or "",
        detail=cells.get(f"{prefix}detail") or "",
        ce_m=number("ce_m"),
        mace_m=number("mace_m"),
        prior_ce_m=_number(cells, "prior_ce_m", where),
        source=cells.get(f"{prefix}source") or "",
        confidence=number("confidence"),
        entropy=number("entropy"),
        sigma_m=number("sigma_m"),
        u_m=number("u_m"),
        agreement_m=number("agreement_m"),
        support=number("support"),
        risk=_probability(cells, f"{prefix}risk", where),
        ce90_m=number("ce90_m"),
        camera_ce_m=number("camera_ce_m"),
        camera_ce90_m=number("camera_ce90_m"),
        single=single,
    )


def _has_estimate(cells: Cells, prefix: str) -> bool:
    """Tell whether there is an answer; the single frame's may be written without its position."""
    if not prefix:
        return bool(cells["lat"] and cells["lon"])
    return any(cells.get(prefix + column) for column in _EVIDENCE_OF_AN_ESTIMATE)


def _is_accepted(cells: Cells, prefix: str, where: str) -> bool:
    """Read the verdict; where a frame alone has no answer, its cell is empty or false."""
    column = f"{prefix}accepted"
    cell = cells[column] or ""
    if prefix and not cell:
        return False
    if cell not in _ACCEPTED:
        raise ResultsError(f"{where}: {column} is {cell!r}, expected true or false")
    return _ACCEPTED[cell]


def _probability(cells: Cells, column: str, where: str) -> float:
    """Read a probability; NaN for an empty cell or an absent column."""
    value = _number(cells, column, where)
    if value < 0.0 or value > 1.0:
        raise ResultsError(f"{where}: {column} is {cells[column]!r}, expected 0 to 1")
    return value


def _number(cells: Cells, column: str, where: str) -> float:
    """Read a number; NaN for an empty cell or an absent column."""
    cell = cells.get(column)
    if not cell:
        return math.nan
    try:
        return float(cell)
    except ValueError as error:
        kind = "metres" if column.endswith("_m") else "a number"
        raise ResultsError(f"{where}: {column} is {cell!r}, expected {kind}") from error
