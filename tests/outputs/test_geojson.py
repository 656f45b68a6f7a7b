import itertools
import json
import math
from typing import Any

import numpy as np
import pytest
from frame_results import (
    CORNERS_DEG,
    UNCERTAIN_DETAIL,
    make_failure,
    make_fix,
    make_prior,
    make_rejected,
)
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from uasthn_cli.outputs.geojson import camera_geometry, footprint_geometry, frames_geojson
from uasthn_cli.types import FrameResult


def signed_area(ring: list[list[float]]) -> float:
    return 0.5 * sum(a[0] * b[1] - b[0] * a[1] for a, b in itertools.pairwise(ring))


def footprint(
    lat: float, lon: float, yaw_deg: float, half_deg: tuple[float, float] = (0.002, 0.0015)
) -> NDArray[np.float64]:
    """Corners (lat, lon) of a frame wider than high, turned clockwise by its heading."""
    right, up = half_deg
    c, s = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    offsets = [(-right, up), (right, up), (-right, -up), (right, -up)]
    return np.array([[lat + y * c - x * s, lon + x * c + y * s] for x, y in offsets])


def features(*results: FrameResult) -> list[dict[str, Any]]:
    collection = json.loads("".join(frames_geojson(results)))
    assert collection["type"] == "FeatureCollection"
    assert set(collection) == {"type", "features"}
    found: list[dict[str, Any]] = collection["features"]
    return found


def test_a_frame_is_a_point_and_a_polygon_in_lon_lat_order() -> None:
    camera, ground = features(make_fix())
    assert camera["type"] == ground["type"] == "Feature"
    assert camera["geometry"] == {"type": "Point", "coordinates": [56.0025, 24.001]}
    assert ground["geometry"]["type"] == "Polygon"
    assert ground["geometry"]["coordinates"] == [
        [[56.001, 24.002], [56.001, 24.0], [56.004, 24.0], [56.004, 24.002], [56.001, 24.002]]
    ]
    assert camera["properties"] == ground["properties"] | {"kind": "camera"}
    assert ground["properties"] == {
        "frame": "a.png",
        "kind": "footprint",
        "time_utc": "2025-11-22T08:26:42.000Z",
        "accepted": True,
        "reason": None,
        "detail": None,
        "u_m": 4.5,
        "ce90_m": 7.125,
        "camera_ce90_m": 10.065,
        "risk": 0.0123,
        "offset_m": 75.25,
        "roll_deg": 0.573,
        "pitch_deg": -1.146,
        "yaw_deg": 85.944,
        "agl_m": 270.25,
        "alt_amsl_m": 317.625,
        "source": "fix",
    }


def test_a_rejected_frame_keeps_its_geometry_and_says_why() -> None:
    for feature in features(make_rejected()):
        assert feature["geometry"] is not None
        assert feature["properties"]["accepted"] is False
        assert feature["properties"]["reason"] == "uncertain"
        assert feature["properties"]["detail"] == UNCERTAIN_DETAIL


def test_a_failure_appears_once_without_geometry() -> None:
    (feature,) = features(make_failure(prior=make_prior("c.png")))
    assert feature == {
        "type": "Feature",
        "geometry": None,
        "properties": {
            "frame": "c.png",
            "kind": "failure",
            "time_utc": "2025-11-22T08:26:42.000Z",
            "accepted": False,
            "reason": "unreadable",
            "detail": "truncated PNG",
        },
    }
    assert features(make_failure())[0]["properties"]["time_utc"] is None


@given(
    lat=st.floats(-80, 80),
    lon=st.floats(-179, 179),
    yaw_deg=st.floats(-180, 360),
    mirrored=st.booleans(),
)
def test_convention_rings_are_closed_and_counter_clockwise(
    lat: float, lon: float, yaw_deg: float, mirrored: bool
) -> None:
    corners = footprint(lat, lon, yaw_deg)
    if mirrored:
        corners = corners[[1, 0, 3, 2]]
    geometry = footprint_geometry(corners)
    assert geometry is not None
    (ring,) = geometry["coordinates"]
    assert len(ring) == 5
    assert ring[0] == ring[-1]
    shifted = [[x - lon, y - lat] for x, y in ring]
    assert signed_area(shifted) == pytest.approx(4 * 0.002 * 0.0015, rel=1e-3)


@given(
    offset=st.floats(-0.0014, 0.0014),
    side=st.sampled_from([180.0, -180.0]),
    yaw_deg=st.floats(0, 360),
)
def test_a_footprint_across_the_antimeridian_is_cut_in_two(
    offset: float, side: float, yaw_deg: float
) -> None:
    corners = footprint(10.0, side + offset, yaw_deg)
    corners[:, 1] = (corners[:, 1] + 180.0) % 360.0 - 180.0
    geometry = footprint_geometry(corners)
    assert geometry is not None
    assert geometry["type"] == "MultiPolygon"
    rings = [polygon[0] for polygon in geometry["coordinates"]]
    total = 0.0
    for ring in rings:
        longitudes = [x for x, _ in ring]
        assert ring[0] == ring[-1]
        assert all(abs(x) <= 180 for x in longitudes)
        assert max(longitudes) - min(longitudes) < 0.01
        area = signed_area([[x - longitudes[0], y - 10.0] for x, y in ring])
        assert area > 0
        total += area
    assert {math.copysign(180.0, ring[0][0]) for ring in rings} == {180.0, -180.0}
    assert total == pytest.approx(4 * 0.002 * 0.0015, rel=1e-3)


def test_a_footprint_that_only_touches_the_antimeridian_stays_whole() -> None:
    corners = np.array([[1.0, 180.0], [1.0, -179.99], [0.0, 180.0], [0.0, -179.99]])
    geometry = footprint_geometry(corners)
    assert geometry is not None
    assert geometry["type"] == "Polygon"
    assert sorted({x for x, _ in geometry["coordinates"][0]}) == [-180.0, -179.99]


def test_what_is_not_finite_has_no_geometry_and_valid_json() -> None:
    corners = CORNERS_DEG.copy()
    corners[2, 0] = math.nan
    assert footprint_geometry(corners) is None
    assert camera_geometry(math.inf, 0.0) is None
    camera, ground = features(make_fix(corners_deg=corners, uncertainty_m=math.inf))
    assert camera["geometry"] is not None
    assert ground["geometry"] is None
    assert ground["properties"]["u_m"] is None


def test_a_collapsed_footprint_is_still_a_closed_ring() -> None:
    geometry = footprint_geometry(np.tile([[24.0, 56.0]], (4, 1)))
    assert geometry == {"type": "Polygon", "coordinates": [[[56.0, 24.0]] * 5]}


def test_longitudes_beyond_180_are_wrapped() -> None:
    assert camera_geometry(1.0, 190.0) == {"type": "Point", "coordinates": [-170.0, 1.0]}
    assert camera_geometry(1.0, -180.0) == {"type": "Point", "coordinates": [-180.0, 1.0]}


def test_text_is_deterministic_utf8_with_a_line_per_feature() -> None:
    results: list[FrameResult] = [make_fix("größe, 1.png"), make_failure("bad\udcff.png")]
    text = "".join(frames_geojson(results))
    assert text == "".join(frames_geojson(results))
    assert "größe, 1.png" in text
    assert text.encode("utf-8").count(b"\n") == 5
    assert text.endswith("\n")


def test_no_frames_give_an_empty_collection() -> None:
    assert features() == []
