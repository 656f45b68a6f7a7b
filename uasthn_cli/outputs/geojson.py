"""``frames.geojson``: camera positions and footprints as an RFC 7946 FeatureCollection."""

import json
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from uasthn_cli.outputs.formatting import (
    ANGLE_DECIMALS,
    DEGREE_DECIMALS,
    METRE_DECIMALS,
    SHARE_DECIMALS,
    finite_or_none,
    frame_of,
    iso_utc,
    safe_text,
    time_of,
)
from uasthn_cli.types import Fix, FloatArray, FrameFailure, FrameResult

_RING: Final = (0, 2, 3, 1)  # top-left, bottom-left, bottom-right, top-right
_MIN_AREA_DEG2: Final = 1e-14


def frames_geojson(results: Sequence[FrameResult]) -> Iterator[str]:
    """Yield the feature collection as pieces of text, one feature a line.

    A frame with an estimate is a ``camera`` Point and a ``footprint`` Polygon; a frame without one
    is a single ``failure`` feature whose geometry is null (RFC 7946, section 3.2).
    """
    yield '{"type": "FeatureCollection", "features": ['
    separator = "\n"
    for result in results:
        for feature in _features(result):
            yield separator + json.dumps(feature, ensure_ascii=False, allow_nan=False)
            separator = ",\n"
    yield "\n]}\n" if results else "\n\n]}\n"


def camera_geometry(lat_deg: float, lon_deg: float) -> dict[str, Any] | None:
    """Return a Point, longitude within ±180; None if the position is not finite."""
    if not np.isfinite([lat_deg, lon_deg]).all():
        return None
    return {"type": "Point", "coordinates": _position((_wrapped(lon_deg), lat_deg))}


def footprint_geometry(corners_deg: FloatArray) -> dict[str, Any] | None:
    """Return the footprint of corners ``(4, 2)`` ``(lat, lon)``; None if not finite.

    The ring is closed and counter-clockwise (RFC 7946, section 3.1.6). One that crosses the
    antimeridian is cut there into a MultiPolygon (section 3.1.9). Poles are not considered.
    """
    corners = np.asarray(corners_deg, dtype=np.float64)
    if not np.isfinite(corners).all():
        return None
    lat, lon = corners[list(_RING)].T
    first = _wrapped(float(lon[0]))
    ring = np.stack([first + (lon - first + 180.0) % 360.0 - 180.0, lat], axis=-1)
    if _area(ring) < 0:
        ring = ring[::-1]
    parts = [part for part in _cut(ring) if abs(_area(part)) > _MIN_AREA_DEG2]
    if len(parts) > 1:
        return {"type": "MultiPolygon", "coordinates": [[_closed(part)] for part in parts]}
    return {"type": "Polygon", "coordinates": [_closed(parts[0] if parts else ring)]}


def _features(result: FrameResult) -> list[dict[str, Any]]:
    """Return the features of one frame."""
    if isinstance(result, FrameFailure):
        properties = _properties(result, "failure") | {
            "accepted": False,
            "reason": result.reason.value,
            "detail": safe_text(result.detail),
        }
        return [{"type": "Feature", "geometry": None, "properties": properties}]
    geometries = {
        "camera": camera_geometry(result.lat_deg, result.lon_deg),
        "footprint": footprint_geometry(result.corners_deg),
    }
    return [
        {
            "type": "Feature",
            "geometry": geometry,
            "properties": _properties(result, kind) | _fix_properties(result),
        }
        for kind, geometry in geometries.items()
    ]


def _properties(result: FrameResult, kind: str) -> dict[str, Any]:
    """Return what every feature says of itself."""
    return {
        "frame": safe_text(frame_of(result).name),
        "kind": kind,
        "time_utc": iso_utc(time_of(result)) or None,
    }


def _fix_properties(fix: Fix) -> dict[str, Any]:
    """Return what an estimate is worth."""
    return {
        "accepted": bool(fix.accepted),
        "reason": fix.reason.value if fix.reason else None,
        "detail": safe_text(fix.detail) or None,
        "u_m": finite_or_none(fix.uncertainty_m, METRE_DECIMALS),
        "offset_m": finite_or_none(fix.offset_m, METRE_DECIMALS),
        "roll_deg": finite_or_none(fix.roll_deg, ANGLE_DECIMALS),
        "pitch_deg": finite_or_none(fix.pitch_deg, ANGLE_DECIMALS),
        "yaw_deg": finite_or_none(fix.yaw_deg, ANGLE_DECIMALS),
        "ce90_m": finite_or_none(fix.trust.ce90_m, METRE_DECIMALS),
        "camera_ce90_m": finite_or_none(fix.camera_ce90_m, METRE_DECIMALS),
        "risk": finite_or_none(fix.trust.risk, SHARE_DECIMALS),
        "agl_m": finite_or_none(fix.height_above_ground_m, METRE_DECIMALS),
        "alt_amsl_m": finite_or_none(fix.alt_amsl_m, METRE_DECIMALS),
        "source": fix.source.value,
    }


def _wrapped(lon_deg: float) -> float:
    """Return a longitude within ±180."""
    return lon_deg if abs(lon_deg) <= 180.0 else (lon_deg + 180.0) % 360.0 - 180.0


def _area(ring: FloatArray) -> float:
    """Return the signed area of an open ring ``(n, 2)``, positive if counter-clockwise."""
    x, y = (ring - ring.mean(axis=0)).T if len(ring) else ring.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _cut(ring: FloatArray) -> list[FloatArray]:
    """Cut an open ring of ``(lon, lat)`` at ±180 and move each part into that range."""
    meridian = 180.0 if ring[:, 0].max() > 180.0 else -180.0
    if np.abs(ring[:, 0]).max() <= 180.0:
        return [ring]
    west, east = _clipped(ring, meridian, keep=-1.0), _clipped(ring, meridian, keep=1.0)
    turn = np.array([360.0, 0.0])
    return [west, east - turn] if meridian > 0 else [west + turn, east]


def _clipped(ring: FloatArray, meridian_deg: float, keep: float) -> FloatArray:
    """Return what lies west (``keep`` -1) or east (+1) of a meridian (Sutherland-Hodgman)."""
    kept: list[FloatArray] = []
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        inside_a = keep * (a[0] - meridian_deg) >= 0
        inside_b = keep * (b[0] - meridian_deg) >= 0
        if inside_a:
            kept.append(a)
        if inside_a != inside_b:
            share = (meridian_deg - a[0]) / (b[0] - a[0])
            kept.append(np.array([meridian_deg, a[1] + share * (b[1] - a[1])]))
    return np.array(kept).reshape(-1, 2)


def _closed(ring: FloatArray) -> list[list[float]]:
    """Return a ring as positions, the first one repeated at the end."""
    positions = [_position(point) for point in ring]
    return [*positions, positions[0]]


def _position(lon_lat_deg: Sequence[float] | FloatArray) -> list[float]:
    """Return ``[lon, lat]`` rounded as in the table; adding zero turns -0.0 into 0.0."""
    return [round(float(value), DEGREE_DECIMALS) + 0.0 for value in lon_lat_deg]
