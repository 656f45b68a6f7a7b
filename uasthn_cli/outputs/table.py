"""``frames.csv``: one row per frame, byte-identical for identical results."""

import csv
import io
from collections.abc import Iterator, Sequence
from itertools import chain, product
from typing import Final

import numpy as np

from uasthn_cli.geometry.geodesy import is_geographic, to_crs
from uasthn_cli.outputs.formatting import (
    ANGLE_DECIMALS,
    DEGREE_DECIMALS,
    METRE_DECIMALS,
    SHARE_DECIMALS,
    fixed,
    frame_of,
    iso_utc,
    safe_text,
    time_of,
)
from uasthn_cli.outputs.truth import (
    Truth,
    camera_error_m,
    center_error_m,
    mean_corner_error_m,
    prior_error_m,
)
from uasthn_cli.types import Fix, FloatArray, FrameFailure, FrameResult, Prior, Source, Trust

CORNERS: Final = ("tl", "tr", "bl", "br")
_PLACE: Final = ("lat", "lon", "center_lat", "center_lon")
_CORNER_PLACES: Final = tuple(f"{c}_{axis}" for c, axis in product(CORNERS, ("lat", "lon")))
LEADING_COLUMNS: Final = (
    *("frame", "time_utc", *_PLACE),
    *("accepted", "reason", "u_m", "offset_m"),
    *_CORNER_PLACES,
    *("prior_lat", "prior_lon", "agl_m", "alt_amsl_m"),
    *("roll_deg", "pitch_deg", "yaw_deg", "gsd_m", "source"),
    *(f"u_{corner}_{axis}_m" for corner, axis in product(CORNERS, ("x", "y"))),
)
TRUST_COLUMNS: Final = (
    *("ce90_m", "risk", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2"),
    *("camera_ce90_m", "camera_cov_xx_m2", "camera_cov_xy_m2", "camera_cov_yy_m2"),
    *("confidence", "entropy", "sigma_m", "agreement_m", "support"),
)
SINGLE_PREFIX: Final = "single_"
"""Begins the columns of a frame's own answer in a run whose answers are the flight's."""

_SINGLE_PARTS: Final = (
    *("accepted", "reason", *_PLACE, "u_m", "offset_m", *_CORNER_PLACES),
    *("ce90_m", "risk", "confidence", "entropy", "sigma_m"),
)
PROJECTED_COLUMNS: Final = ("x", "y", "center_x", "center_y")

_RISK_DECIMALS: Final = 6
_GSD_DECIMALS: Final = 5  # multiplied by hundreds of pixels before it is a distance


def columns(truth: Truth | None, crs: str | None, with_single: bool = False) -> list[str]:
    """Return the header: leading columns, errors against truth, the rest, positions in a CRS.

    ``with_single`` adds each frame's own answer beside the flight's.
    """
    errors = ["ce_m", "mace_m"] if truth else []
    camera_errors = ["camera_ce_m", "prior_ce_m"] if truth and truth.has_camera else []
    projected = PROJECTED_COLUMNS if crs else ()
    single = [*_SINGLE_PARTS, *errors] if with_single else []
    return [
        *LEADING_COLUMNS,
        *errors,
        *camera_errors,
        *TRUST_COLUMNS,
        *(SINGLE_PREFIX + name for name in single),
        "detail",
        *projected,
    ]


def to_rows(
    results: Sequence[FrameResult], truth: Truth | None, crs: str | None
) -> Iterator[list[str]]:
    """Yield one row of cells per result, in the order of :func:`columns`.

    A rejected frame keeps its estimate; what a frame without one does not know stays empty.

    Raises:
        ValueError: the CRS is not understood.
    """
    names = columns(truth, crs, has_single(results))
    for result, projected in zip(results, _projected_cells(results, crs), strict=True):
        cells = _common_cells(result) | projected | _error_cells(result, truth)
        cells |= _fix_cells(result) if isinstance(result, Fix) else _failure_cells(result)
        cells |= _single_cells(result, truth)
        yield [cells.get(name, "") for name in names]


def frames_csv(
    results: Sequence[FrameResult], truth: Truth | None, crs: str | None
) -> Iterator[str]:
    """Yield the table as lines of CSV: quoted by RFC 4180, ended by a line feed.

    Raises:
        ValueError: the CRS is not understood.
    """
    for cells in chain([columns(truth, crs, has_single(results))], to_rows(results, truth, crs)):
        line = io.StringIO(newline="")
        csv.writer(line, lineterminator="\n").writerow(cells)
        yield line.getvalue()


def has_single(results: Sequence[FrameResult]) -> bool:
    """Tell whether the answers are the flight's, with each frame's own beside them."""
    return any(isinstance(result, Fix) and result.source is not Source.FIX for result in results)


def _common_cells(result: FrameResult) -> dict[str, str]:
    """Return what every result may know: frame, time, prior."""
    cells = {"frame": safe_text(frame_of(result).name), "time_utc": iso_utc(time_of(result))}
    prior: Prior | None = result.prior
    if prior is not None:
        cells["prior_lat"] = fixed(prior.lat_deg, DEGREE_DECIMALS)
        cells["prior_lon"] = fixed(prior.lon_deg, DEGREE_DECIMALS)
        cells["agl_m"] = fixed(prior.height_above_ground_m, METRE_DECIMALS)
        cells["alt_amsl_m"] = fixed(prior.alt_amsl_m, METRE_DECIMALS)
    return cells


def _failure_cells(failure: FrameFailure) -> dict[str, str]:
    """Return why there is no estimate."""
    detail = safe_text(failure.detail)
    return {"accepted": "false", "reason": failure.reason.value, "detail": detail}


def _fix_cells(fix: Fix) -> dict[str, str]:
    """Return the estimate, its uncertainty and what it is worth."""
    cells = {
        "lat": fixed(fix.lat_deg, DEGREE_DECIMALS),
        "lon": fixed(fix.lon_deg, DEGREE_DECIMALS),
        "center_lat": fixed(fix.center_lat_deg, DEGREE_DECIMALS),
        "center_lon": fixed(fix.center_lon_deg, DEGREE_DECIMALS),
        "accepted": "true" if fix.accepted else "false",
        "reason": fix.reason.value if fix.reason else "",
        "detail": safe_text(fix.detail),
        "u_m": fixed(fix.uncertainty_m, METRE_DECIMALS),
        "offset_m": fixed(fix.offset_m, METRE_DECIMALS),
        "agl_m": fixed(fix.height_above_ground_m, METRE_DECIMALS),
        "alt_amsl_m": fixed(fix.alt_amsl_m, METRE_DECIMALS),
        "roll_deg": fixed(fix.roll_deg, ANGLE_DECIMALS),
        "pitch_deg": fixed(fix.pitch_deg, ANGLE_DECIMALS),
        "yaw_deg": fixed(fix.yaw_deg, ANGLE_DECIMALS),
        "gsd_m": fixed(fix.gsd_m, _GSD_DECIMALS),
        "source": fix.source.value,
    }
    cells |= _trust_cells(fix.trust)
    cells |= {"camera_ce90_m": fixed(fix.camera_ce90_m, METRE_DECIMALS)}
    cells |= _covariance_cells("camera_cov", fix.camera_covariance_m2)
    for k, corner in enumerate(CORNERS):
        cells[f"{corner}_lat"] = fixed(fix.corners_deg[k, 0], DEGREE_DECIMALS)
        cells[f"{corner}_lon"] = fixed(fix.corners_deg[k, 1], DEGREE_DECIMALS)
        cells[f"u_{corner}_x_m"] = fixed(fix.corner_std_m[k, 0], METRE_DECIMALS)
        cells[f"u_{corner}_y_m"] = fixed(fix.corner_std_m[k, 1], METRE_DECIMALS)
    return cells


def _trust_cells(trust: Trust) -> dict[str, str]:
    """Return what is known of the error."""
    return {
        "ce90_m": fixed(trust.ce90_m, METRE_DECIMALS),
        "risk": fixed(trust.risk, _RISK_DECIMALS),
        **_covariance_cells("cov", trust.covariance_m2),
        "confidence": fixed(trust.confidence, SHARE_DECIMALS),
        "entropy": fixed(trust.entropy_nats, SHARE_DECIMALS),
        "sigma_m": fixed(trust.sigma_m, METRE_DECIMALS),
        "agreement_m": fixed(trust.agreement_m, METRE_DECIMALS),
        "support": fixed(trust.support, SHARE_DECIMALS),
    }


def _covariance_cells(name: str, covariance_m2: FloatArray) -> dict[str, str]:
    """Return a covariance ``(2, 2)`` (east, north)."""
    return {
        f"{name}_xx_m2": fixed(covariance_m2[0, 0], METRE_DECIMALS),
        f"{name}_xy_m2": fixed(covariance_m2[0, 1], METRE_DECIMALS),
        f"{name}_yy_m2": fixed(covariance_m2[1, 1], METRE_DECIMALS),
    }


def _single_cells(result: FrameResult, truth: Truth | None) -> dict[str, str]:
    """Return a frame's own answer, where the main one is the flight's."""
    if isinstance(result, FrameFailure):
        return {"single_accepted": "false", "single_reason": result.reason.value}
    if result.single is None:
        own_reason = result.reason.value if result.reason else ""
        return {"single_accepted": "false", "single_reason": own_reason}
    single = result.single
    cells = _fix_cells(single) | _error_cells(single, truth)
    return {SINGLE_PREFIX + name: value for name, value in cells.items()}


def _error_cells(result: FrameResult, truth: Truth | None) -> dict[str, str]:
    """Return the errors against truth; nothing where the table does not list the frame."""
    true = truth.frames.get(frame_of(result).name) if truth else None
    if true is None:
        return {}
    cells = {}
    if isinstance(result, Fix):
        cells["ce_m"] = fixed(center_error_m(result, true), METRE_DECIMALS)
        cells["mace_m"] = fixed(mean_corner_error_m(result, true), METRE_DECIMALS)
        cells["camera_ce_m"] = fixed(camera_error_m(result, true), METRE_DECIMALS)
    if result.prior is not None:
        cells["prior_ce_m"] = fixed(prior_error_m(result.prior, true), METRE_DECIMALS)
    return cells


def _projected_cells(results: Sequence[FrameResult], crs: str | None) -> Iterator[dict[str, str]]:
    """Yield camera and centre in another CRS per result, all transformed at once."""
    if crs is None:
        yield from ({} for _ in results)
        return
    decimals = DEGREE_DECIMALS if is_geographic(crs) else METRE_DECIMALS
    degrees = [
        [[fix.lat_deg, fix.lon_deg], [fix.center_lat_deg, fix.center_lon_deg]]
        for fix in results
        if isinstance(fix, Fix)
    ]
    points = iter(to_crs(crs, np.array(degrees).reshape(-1, 2, 2)).reshape(-1, 4))
    for result in results:
        values = next(points) if isinstance(result, Fix) else ()
        yield {
            name: fixed(value, decimals)
            for name, value in zip(PROJECTED_COLUMNS, values, strict=False)
        }
