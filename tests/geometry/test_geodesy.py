"""Degrees ⇄ metres, against geodesics on the ellipsoid and known positions."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pyproj import Geod

from uasthn_cli.geometry.geodesy import LocalFrame, distance_m, from_crs, to_crs

GEOD = Geod(ellps="WGS84")

latitudes = st.floats(-80.0, 80.0)
longitudes = st.floats(-179.9, 179.9)
offsets_m = st.floats(-20_000.0, 20_000.0)

few_examples = settings(max_examples=40)
"""Each example sets up a projection, which takes milliseconds."""


@few_examples
@given(latitudes, longitudes, offsets_m, offsets_m)
@example(lat_deg=0.0, lon_deg=9.208283316467923e-09, east_m=0.0, north_m=0.0)
def test_local_metres_are_geodesic_metres(
    lat_deg: float, lon_deg: float, east_m: float, north_m: float
) -> None:
    # PROJ takes a central meridian within 1e-8 degrees (a millimetre) of Greenwich for Greenwich
    frame = LocalFrame(lat_deg, lon_deg)
    lat, lon = frame.to_degrees(np.array([east_m, north_m]))
    _, _, geodesic_m = GEOD.inv(lon_deg, lat_deg, lon, lat)
    assert geodesic_m == pytest.approx(np.hypot(east_m, north_m), rel=5e-6, abs=2e-3)


@few_examples
@given(latitudes, longitudes, offsets_m, offsets_m)
def test_local_metres_survive_the_round_trip(
    lat_deg: float, lon_deg: float, east_m: float, north_m: float
) -> None:
    frame = LocalFrame(lat_deg, lon_deg)
    metres = np.array([[east_m, north_m], [0.0, 0.0]])
    np.testing.assert_allclose(frame.to_metres(frame.to_degrees(metres)), metres, atol=1e-6)


@few_examples
@given(latitudes, longitudes)
def test_convention_local_frame_points_to_true_north(lat_deg: float, lon_deg: float) -> None:
    frame = LocalFrame(lat_deg, lon_deg)
    np.testing.assert_allclose(frame.to_metres(np.array([lat_deg, lon_deg])), [0, 0], atol=1e-3)
    north, east = frame.to_degrees(np.array([[0.0, 1000.0], [1000.0, 0.0]]))
    assert north[1] == pytest.approx(lon_deg, abs=1e-7)
    assert north[0] > lat_deg
    azimuth_deg, _, _ = GEOD.inv(lon_deg, lat_deg, east[1], east[0])
    assert azimuth_deg == pytest.approx(90.0, abs=0.01)


@given(latitudes, longitudes, latitudes, longitudes)
def test_distances_are_those_of_the_ellipsoid(
    lat_a: float, lon_a: float, lat_b: float, lon_b: float
) -> None:
    _, _, expected_m = GEOD.inv(lon_a, lat_a, lon_b, lat_b)
    got_m = distance_m(np.array([lat_a, lon_a]), np.array([lat_b, lon_b]))
    assert float(got_m) == pytest.approx(expected_m)


def test_distances_broadcast() -> None:
    points = np.array([[60.0, 24.0], [60.0, 24.1], [60.1, 24.0]])
    assert distance_m(points, points[0]).shape == (3,)
    assert distance_m(points, points[0])[0] == 0.0


def test_convention_crs_coordinates_are_x_then_y() -> None:
    on_the_central_meridian, further_east = to_crs("EPSG:32640", np.array([[0, 57], [0, 57.5]]))
    np.testing.assert_allclose(on_the_central_meridian, [500_000.0, 0.0], atol=1e-6)
    equator_m = np.radians(0.5) * 6378137.0
    np.testing.assert_allclose(further_east, [500_000.0 + 0.9996 * equator_m, 0.0], atol=1.0)
    degrees = to_crs("EPSG:4326", np.array([23.5, 56.25]))
    np.testing.assert_allclose(degrees, [56.25, 23.5])


@given(st.floats(-70.0, 70.0), st.floats(52.0, 62.0))
def test_crs_coordinates_survive_the_round_trip(lat_deg: float, lon_deg: float) -> None:
    place = np.array([[lat_deg, lon_deg]])
    for crs in ("EPSG:32640", "EPSG:3857", "EPSG:4326"):
        np.testing.assert_allclose(from_crs(crs, to_crs(crs, place)), place, atol=1e-8)


def test_a_crs_that_is_unknown_or_not_on_earth_is_refused() -> None:
    place = np.array([60.0, 24.0])
    with pytest.raises(ValueError, match="unknown"):
        to_crs("EPSG:999999", place)
    with pytest.raises(ValueError, match="site grid"):
        from_crs('LOCAL_CS["site grid",UNIT["metre",1],AXIS["X",EAST],AXIS["Y",NORTH]]', place)


def test_points_off_the_map_projection_come_back_infinite() -> None:
    assert not np.isfinite(to_crs("EPSG:3857", np.array([95.0, 0.0]))).any()
