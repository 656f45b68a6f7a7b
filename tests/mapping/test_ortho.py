"""A rectified frame shows the ground in place, and only what the frame saw."""

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from uasthn_cli.geometry.camera import (
    focal_from_hfov_px,
    homography_frame_ground,
    undistort_points,
)
from uasthn_cli.geometry.corners import image_corners_px, transform_points
from uasthn_cli.geometry.surface import CameraOverSurface, FlatGround, Relief, Surface
from uasthn_cli.mapping.ortho import (
    FootprintSizeError,
    ObliqueFrameError,
    TexturelessFrameError,
    rectify,
)
from uasthn_cli.types import (
    Attitude,
    CameraModel,
    FloatArray,
    FrameFile,
    ImageArray,
    Ortho,
    Prior,
)

FOCAL_PX = focal_from_hfov_px(320, 45.0)
CAMERA = CameraModel(320, 256, FOCAL_PX, FOCAL_PX, 159.5, 127.5)
HEIGHT_M = 120.0
SQUARE_M = 12.0
NADIR = Attitude(0.0, 0.0, 0.0)
TILTED = Attitude(math.radians(5), math.radians(-8), math.radians(37))


def prior(attitude: Attitude = NADIR, height_m: float = HEIGHT_M) -> Prior:
    frame = FrameFile("frame.png", Path("frame.png"))
    return Prior(frame, 0.0, 47.0, -99.0, height_m, attitude, "test")


def chessboard(east_m: FloatArray, north_m: FloatArray) -> FloatArray:
    """Return a chessboard on the ground, corners where both coordinates are odd half squares."""
    odd = np.floor(east_m / SQUARE_M + 0.5) + np.floor(north_m / SQUARE_M + 0.5)
    return np.asarray(odd % 2, dtype=np.float64)


def render(camera: CameraModel, attitude: Attitude, height_m: float = HEIGHT_M) -> ImageArray:
    """Return what the camera sees of the chessboard, 5 × 5 rays to a pixel."""
    finer = 5
    H = homography_frame_ground(camera, attitude, height_m)
    x = (np.arange(camera.width_px * finer) + 0.5) / finer - 0.5
    y = (np.arange(camera.height_px * finer) + 0.5) / finer - 0.5
    pixels: FloatArray = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(np.float64)
    ground = transform_points(H, undistort_points(camera, pixels))
    shape = (camera.height_px, finer, camera.width_px, finer)
    return np.asarray(
        chessboard(ground[:, 0], ground[:, 1]).reshape(shape).mean(axis=(1, 3)), dtype=np.float32
    )


def corner_errors_px(ortho: Ortho) -> FloatArray:
    """Return how far the chessboard's corners lie from where the conventions put them."""
    steps = (np.arange(-12, 12) + 0.5) * SQUARE_M
    metres = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    expected = metres / (ortho.gsd_m, -ortho.gsd_m) + ortho.nadir_px
    reach = 5
    clear = cv2.erode(ortho.valid.astype(np.uint8), np.ones((4 * reach, 4 * reach), np.uint8))
    clear[[0, -1]] = clear[:, [0, -1]] = 0
    kept = [
        point
        for point in expected
        if (np.round(point) >= 0).all()
        and (np.round(point) < ortho.valid.shape[::-1]).all()
        and clear[round(point[1]), round(point[0])]
    ]
    start = np.array(kept, dtype=np.float32)[:, None]
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-3)
    found = cv2.cornerSubPix(ortho.image, start.copy(), (reach, reach), (-1, -1), criteria)
    return np.asarray(np.linalg.norm(found[:, 0] - np.array(kept), axis=-1), dtype=np.float64)


@pytest.mark.parametrize("gsd_m", [0.4, 0.6, 0.9])
@pytest.mark.parametrize(
    "camera",
    [CAMERA, replace(CAMERA, mount_yaw_rad=0.7), replace(CAMERA, distortion=(-0.2, 0.05))],
    ids=["plain", "turned mount", "distorted"],
)
def test_convention_the_ground_comes_back_in_place(camera: CameraModel, gsd_m: float) -> None:
    ortho = rectify(render(camera, TILTED), camera, prior(TILTED), gsd_m)
    errors_px = corner_errors_px(ortho)
    assert len(errors_px) >= 16
    assert errors_px.max() < 0.1


@pytest.mark.parametrize("gsd_m", [0.7, 1.3, 2.1, 3.0, 5.2])
def test_convention_strong_reductions_do_not_shift_the_ground(gsd_m: float) -> None:
    wavelength_m = 9 * gsd_m

    def waves(metres: FloatArray) -> FloatArray:
        phase = metres @ np.array([[0.8, 0.6], [-0.6, 0.8]]) * 2 * math.pi / wavelength_m
        return np.asarray(np.sin(phase).sum(axis=-1), dtype=np.float64)

    x, y = np.meshgrid(np.arange(320.0), np.arange(256.0))
    pixels = np.stack([x, y], axis=-1).reshape(-1, 2)
    seen = waves(transform_points(homography_frame_ground(CAMERA, TILTED, HEIGHT_M), pixels))
    frame = seen.reshape(256, 320).astype(np.float32)
    ortho = rectify(frame, CAMERA, prior(TILTED), gsd_m)

    rows, columns = np.nonzero(cv2.erode(ortho.valid.astype(np.uint8), np.ones((5, 5), np.uint8)))
    metres = (np.stack([columns, rows], axis=-1) - ortho.nadir_px) * (gsd_m, -gsd_m)
    step = gsd_m / 2
    slopes = [waves(metres + axis) - waves(metres - axis) for axis in np.eye(2) * step]
    design = np.stack([waves(metres), *slopes], axis=-1)
    gain, east_px, north_px = np.linalg.lstsq(design, ortho.image[rows, columns], rcond=None)[0]
    assert 0.85 < gain < 1.0
    assert math.hypot(east_px, north_px) / gain < 0.1


def test_convention_ortho_is_north_up_with_x_to_the_east() -> None:
    image = np.zeros((256, 320), dtype=np.float32)
    image[20:40, 100:120] = 1.0
    attitude = replace(NADIR, yaw_rad=math.pi / 2)
    ortho = rectify(image, CAMERA, prior(attitude), 0.5)
    rows, columns = np.nonzero(ortho.image > 0.5)
    ahead_of_nadir, left_of_nadir = 127.5 - 29.5, 159.5 - 109.5
    scale = HEIGHT_M / FOCAL_PX / 0.5
    expected = ortho.nadir_px + np.array([ahead_of_nadir, -left_of_nadir]) * scale
    np.testing.assert_allclose([columns.mean(), rows.mean()], expected, atol=0.5)
    assert ortho.image.shape[0] > ortho.image.shape[1]


def test_frame_homography_leads_through_the_ground() -> None:
    ortho = rectify(render(CAMERA, TILTED), CAMERA, prior(TILTED), 0.6)
    corners = image_corners_px(320, 256)
    metres = transform_points(homography_frame_ground(CAMERA, TILTED, HEIGHT_M), corners)
    expected = metres / (0.6, -0.6) + ortho.nadir_px
    np.testing.assert_allclose(transform_points(ortho.H_frame_ortho, corners), expected, atol=1e-6)
    assert ortho.H_frame_ortho[2, 2] == 1.0


@pytest.mark.parametrize("multiple_px", [1, 8, 32])
def test_ortho_is_just_large_enough(multiple_px: int) -> None:
    ortho = rectify(render(CAMERA, TILTED), CAMERA, prior(TILTED), 0.6, multiple_px=multiple_px)
    corners = transform_points(ortho.H_frame_ortho, image_corners_px(320, 256))
    size = np.array(ortho.image.shape[::-1])
    assert (size % multiple_px == 0).all()
    assert (corners >= 0).all()
    assert (corners <= size - 1).all()
    spare = size - 1 - np.ptp(corners, axis=0)
    assert (spare < multiple_px + 2).all()
    assert ortho.valid.shape == ortho.image.shape
    assert ortho.image.dtype == np.float32


@pytest.mark.parametrize("gsd_m", [0.2, 0.6, 2.0])
@pytest.mark.parametrize("distortion", [(), (0.25,), (-0.25,)])
def test_what_the_frame_did_not_see_is_zero_and_not_valid(
    gsd_m: float, distortion: tuple[float, ...]
) -> None:
    camera = replace(CAMERA, distortion=distortion)
    image = np.ones((256, 320), dtype=np.float32)
    image[127:129, 159:161] = 0.9
    ortho = rectify(image, camera, prior(TILTED), gsd_m)
    assert ortho.image[ortho.valid].min() > 0.89
    assert not ortho.image[~ortho.valid].any()
    expected = np.zeros(ortho.valid.shape, dtype=np.uint8)
    corners = transform_points(ortho.H_frame_ortho, image_corners_px(320, 256))
    cv2.fillConvexPoly(expected, np.round(corners[[0, 1, 3, 2]]).astype(np.int32), 1)
    assert not (ortho.valid & ~cv2.dilate(expected, np.ones((3, 3), np.uint8)).astype(bool)).any()
    share = ortho.valid.sum() / expected.sum()
    assert (0.85 if distortion else 0.94) <= share <= 1.0


def test_fine_detail_is_averaged_and_not_aliased() -> None:
    stripes = np.tile(np.array([0.0, 1.0], dtype=np.float32), (256, 160))
    for gsd_m in (1.0, 2.9, 6.1):
        ortho = rectify(stripes, CAMERA, prior(TILTED), gsd_m)
        assert np.abs(ortho.image[ortho.valid] - 0.5).max() < 0.05


def test_a_tilted_or_horizon_frame_is_too_oblique() -> None:
    image = render(CAMERA, NADIR)
    with pytest.raises(ObliqueFrameError, match="tilted by 31"):
        rectify(image, CAMERA, prior(Attitude(0.0, math.radians(31), 0.0)), 0.6)
    wide = replace(CAMERA, focal_x_px=60.0, focal_y_px=60.0)
    with pytest.raises(ObliqueFrameError, match="horizon"):
        rectify(image, wide, prior(Attitude(0.0, math.radians(29), 0.0)), 0.6)


@pytest.mark.parametrize("value", [0.0, 0.7, 1.0])
def test_a_constant_frame_is_textureless(value: float) -> None:
    with pytest.raises(TexturelessFrameError):
        rectify(np.full((256, 320), value, dtype=np.float32), CAMERA, prior(), 0.6)


@pytest.mark.parametrize("height_m", [0.0, -5.0, float("nan"), float("inf"), 0.5, 1e6])
def test_absurd_heights_give_no_footprint(height_m: float) -> None:
    with pytest.raises(FootprintSizeError, match="footprint"):
        rectify(render(CAMERA, NADIR), CAMERA, prior(height_m=height_m), 0.6)


def test_a_single_pixel_that_stands_out_is_texture() -> None:
    image = np.full((256, 320), 0.5, dtype=np.float32)
    for step, is_texture in ((1 / 255, True), (1e-3, True), (1e-7, False)):
        image[100, 100] = 0.5 + step
        if is_texture:
            assert rectify(image, CAMERA, prior(), 0.6).valid.any()
        else:
            with pytest.raises(TexturelessFrameError):
                rectify(image, CAMERA, prior(), 0.6)


@pytest.mark.parametrize("gsd_m", [0.3, 0.9, 2.2])
def test_valid_pixels_are_those_whose_source_lies_within_the_frame(gsd_m: float) -> None:
    ortho = rectify(render(CAMERA, TILTED), CAMERA, prior(TILTED), gsd_m)
    rows, columns = np.indices(ortho.valid.shape)
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(np.float64)
    source = transform_points(np.asarray(np.linalg.inv(ortho.H_frame_ortho)), pixels)
    last = np.array([CAMERA.width_px, CAMERA.height_px]) - 1.0
    inside = ((source >= 0.0) & (source <= last)).all(axis=-1).reshape(ortho.valid.shape)
    assert not (ortho.valid & ~inside).any()
    well_inside = ((source >= 4.0) & (source <= last - 4.0)).all(axis=-1)
    assert ortho.valid[well_inside.reshape(ortho.valid.shape)].all()


def test_a_frame_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="256 × 320"):
        rectify(np.eye(320, 256, dtype=np.float32), CAMERA, prior(), 0.6)


def over(surface: Surface, camera: CameraModel, prior: Prior) -> CameraOverSurface:
    """Return the camera of a prior 120 m above the height 30 of a surface's datum."""
    return CameraOverSurface(camera, prior.attitude, np.array([40.0, -25.0]), 150.0, surface, 30.0)


@pytest.mark.parametrize("distortion", [(), (-0.2, 0.03)])
@pytest.mark.parametrize("gsd_m", [0.3, 1.0])
def test_over_a_flat_surface_the_ortho_is_that_of_flat_ground(
    distortion: tuple[float, ...], gsd_m: float
) -> None:
    camera = replace(CAMERA, distortion=distortion)
    prior = Prior(FrameFile("x.png", Path("x.png")), 0.0, 0.0, 0.0, HEIGHT_M, TILTED, "x")
    noise = np.random.default_rng(1).random((256, 320)).astype(np.float32)
    image = np.asarray(cv2.GaussianBlur(noise, (0, 0), 3.0), np.float32)
    flat = rectify(image, camera, prior, gsd_m, multiple_px=16)
    same = rectify(
        image, camera, prior, gsd_m, multiple_px=16, over=over(FlatGround(30.0), camera, prior)
    )
    assert same.nadir_px == pytest.approx(flat.nadir_px)
    assert (same.valid != flat.valid).mean() < 1e-3
    both = same.valid & flat.valid
    assert np.abs(same.image - flat.image)[both].max() < 0.05 * flat.image[both].std()


def test_convention_over_relief_things_lie_where_they_are() -> None:
    metres = np.arange(-200.0, 201.0, 5.0)
    east, north = np.meshgrid(metres, -metres)
    relief = Relief(30.0 + 12.0 * np.sin(east / 25.0) * np.cos(north / 30.0), -200.0, 200.0, 5.0)
    prior = Prior(FrameFile("x.png", Path("x.png")), 0.0, 0.0, 0.0, HEIGHT_M, TILTED, "x")
    view = over(relief, CAMERA, prior)
    spots_m = view.to_ground(np.array([[80.0, 60.0], [250.0, 70.0], [90.0, 200.0], [240.0, 190.0]]))
    ys, xs = np.mgrid[:256, :320]
    image = np.zeros((256, 320), np.float32)
    for x, y in view.to_frame(spots_m):
        image += np.exp(-((xs - x) ** 2 + (ys - y) ** 2) / 8.0).astype(np.float32)
    ortho = rectify(image, CAMERA, prior, 0.4, over=view)
    flat = rectify(image, CAMERA, prior, 0.4)
    for spot_m in spots_m:
        expected_px = ortho.nadir_px + (spot_m - view.position_m) / (0.4, -0.4)
        assert _distance_to_spot_px(ortho, expected_px) < 0.5
    shifts_px = [
        _distance_to_spot_px(flat, flat.nadir_px + (spot - view.position_m) / (0.4, -0.4))
        for spot in spots_m
    ]
    assert max(shifts_px) > 2.0


def _distance_to_spot_px(ortho: Ortho, expected_px: FloatArray) -> float:
    """Return how far the weight of a bright spot lies from where it should be."""
    height, width = ortho.image.shape
    ys, xs = np.mgrid[:height, :width]
    near = np.hypot(xs - expected_px[0], ys - expected_px[1]) < 12.0
    weight = np.where(near, ortho.image, 0.0)
    x, y = (weight * xs).sum() / weight.sum(), (weight * ys).sum() / weight.sum()
    return float(math.hypot(x - expected_px[0], y - expected_px[1]))
