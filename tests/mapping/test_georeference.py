"""A raster's place on earth: pixels ⇄ degrees, ground sizes, nearest points, extents."""

import numpy as np
import pytest
from affine import Affine
from hypothesis import given, settings
from hypothesis import strategies as st

from uasthn_cli.geometry.geodesy import LocalFrame, distance_m, to_crs
from uasthn_cli.mapping.georeference import Georeference

LAT_DEG, LON_DEG = 47.05, -99.2


def georeference(crs: str, step_x: float, step_y: float, turn_deg: float = 0.0) -> Georeference:
    """Return a 300 × 200 raster with its top-left corner at the test's place."""
    x, y = to_crs(crs, np.array([LAT_DEG, LON_DEG]))
    turn = Affine.rotation(turn_deg)
    return Georeference(
        crs, Affine.translation(x, y) @ turn @ Affine.scale(step_x, -step_y), 300, 200
    )


PLACES = [
    georeference("EPSG:32614", 0.5, 0.5),
    georeference("EPSG:4326", 2e-5, 1e-5),
    georeference("EPSG:3857", 3.0, 3.0),
    georeference("EPSG:32614", 2.0, 1.0, turn_deg=35.0),
]


@settings(max_examples=30)
@given(st.sampled_from(PLACES), st.floats(-500, 500), st.floats(-500, 500))
def test_pixels_survive_the_way_to_degrees_and_back(
    place: Georeference, x: float, y: float
) -> None:
    point = np.array([[x, y]])
    np.testing.assert_allclose(place.to_pixels(place.to_degrees(point)), point, atol=1e-4)


def test_convention_the_first_pixels_corner_is_the_transforms_origin() -> None:
    for place in PLACES:
        np.testing.assert_allclose(
            place.to_degrees(np.array([-0.5, -0.5])), [LAT_DEG, LON_DEG], atol=1e-9
        )


@pytest.mark.parametrize("place", PLACES)
def test_ground_size_of_a_pixel_is_the_geodesic_one(place: Georeference) -> None:
    corner = np.array([LAT_DEG, LON_DEG])
    jacobian = place.metres_per_pixel(corner)
    for axis, step in enumerate(np.eye(2)):
        side_m = distance_m(place.to_degrees(np.array([-0.5, -0.5])), place.to_degrees(step - 0.5))
        assert np.linalg.norm(jacobian[:, axis]) == pytest.approx(float(side_m), rel=1e-4)
    sides = np.linalg.norm(jacobian, axis=0)
    assert place.gsd_m(corner) == pytest.approx(np.sqrt(np.prod(sides)), rel=1e-4)


def test_convention_map_x_runs_east_and_map_y_south() -> None:
    jacobian = PLACES[0].metres_per_pixel(np.array([LAT_DEG, LON_DEG]))
    np.testing.assert_allclose(jacobian, [[0.5, 0.0], [0.0, -0.5]], atol=0.01)


def test_distance_is_zero_on_the_raster_and_to_its_edge_beside_it() -> None:
    place = PLACES[0]
    inside, east_of_it, above_it = place.to_degrees(
        np.array([[150.0, 100.0], [299.5 + 80, 100.0], [150.0, -0.5 - 60]])
    )
    places = np.stack([inside, east_of_it, above_it])
    np.testing.assert_allclose(place.distance_m(places), [0.0, 40.0, 30.0], atol=0.05)


def test_extent_near_a_flight_is_clipped_to_the_reach() -> None:
    place = PLACES[0]
    frame = LocalFrame(LAT_DEG, LON_DEG)
    whole = place.extent_near(frame, 20_000.0)
    assert whole is not None
    edges_m = [whole.west_m, whole.north_m, whole.east_m, whole.south_m]
    np.testing.assert_allclose(edges_m, [0.0, 0.0, 150.0, -100.0], atol=1.0)
    part = place.extent_near(frame, 30.0)
    assert part is not None
    edges_m = [part.west_m, part.north_m, part.east_m, part.south_m]
    np.testing.assert_allclose(edges_m, [0.0, 0.0, 30.0, -30.0], atol=0.5)


def test_extent_of_the_whole_world_is_what_lies_within_reach() -> None:
    world = Georeference("EPSG:4326", Affine(0.1, 0, -180, 0, -0.1, 90), 3600, 1800)
    extent = world.extent_near(LocalFrame(LAT_DEG, LON_DEG), 20_000.0)
    assert extent is not None
    edges_m = [extent.west_m, extent.north_m, extent.east_m, extent.south_m]
    np.testing.assert_allclose(edges_m, [-20_000, 20_000, 20_000, -20_000])


def test_there_is_no_extent_elsewhere() -> None:
    assert PLACES[0].extent_near(LocalFrame(-35.0, 149.0), 20_000.0) is None
    assert PLACES[1].extent_near(LocalFrame(LAT_DEG, LON_DEG + 1.0), 20_000.0) is None


def test_bounds_enclose_the_raster() -> None:
    south, north, west, east = PLACES[1].bounds_deg()
    assert (south, north) == pytest.approx((LAT_DEG - 200e-5, LAT_DEG))
    assert (west, east) == pytest.approx((LON_DEG, LON_DEG + 600e-5))
