"""What happens to single frames: depth and size stay, corners keep within bounds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.geometry.corners import image_corners_px, is_convex
from uasthn_cli.synth.flight_config import SensorConfig
from uasthn_cli.synth.stress_frames import (
    LARGEST_SHIFT_PX,
    Frame,
    badly_exposed,
    bent,
    blended,
    faded,
    shifted_corners_px,
)

SHAPE = (72, 110)


def frame_of(depth: str) -> Frame:
    rows, columns = np.indices(SHAPE)
    waves = 0.5 + 0.25 * np.sin(rows / 9.0) + 0.25 * np.cos(columns / 13.0)
    scale, base = {"uint8": (255.0, 0.0), "uint16": (400.0, 7000.0), "float32": (9.0, 285.0)}[depth]
    return (base + scale * waves).astype(depth)


def random(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@given(
    width_px=st.integers(32, 2000),
    height_px=st.integers(32, 2000),
    severity=st.floats(0.0, 1.0),
    seed=st.integers(0, 1000),
)
def test_convention_corners_shift_inwards_and_no_farther_than_said(
    width_px: int, height_px: int, severity: float, seed: int
) -> None:
    corners = shifted_corners_px((width_px, height_px), severity, random(seed))
    shift = np.abs(corners - image_corners_px(width_px, height_px))
    largest = severity * LARGEST_SHIFT_PX / 256 * np.array([width_px, height_px])
    assert (shift <= largest + 1e-9).all()
    assert (corners >= 0).all()
    assert (corners <= [width_px - 1, height_px - 1]).all()
    assert is_convex(corners)


def test_the_full_shift_is_nearly_reached() -> None:
    shifts = [
        np.abs(shifted_corners_px((640, 512), 1.0, random(seed)) - image_corners_px(640, 512))
        for seed in range(50)
    ]
    assert np.max(shifts, axis=(0, 1)) == pytest.approx([160.0, 128.0], rel=0.03)


def test_unshifted_corners_change_nothing() -> None:
    frame = frame_of("uint8")
    assert np.array_equal(bent(frame, image_corners_px(SHAPE[1], SHAPE[0])), frame)


@pytest.mark.parametrize("depth", ["uint8", "uint16", "float32"])
def test_depth_and_size_stay(depth: str) -> None:
    frame = frame_of(depth)
    corners = shifted_corners_px((SHAPE[1], SHAPE[0]), 1.0, random())
    changed = [
        faded(frame, 0.5, random(), SensorConfig()),
        badly_exposed(frame, 0.5, random()),
        bent(frame, corners),
        blended(frame, frame[::-1], 0.5),
    ]
    for image in changed:
        assert image.dtype == frame.dtype
        assert image.shape == frame.shape
        assert not np.array_equal(image, frame)


@pytest.mark.parametrize("depth", ["uint8", "uint16"])
def test_contrast_falls_with_severity(depth: str) -> None:
    frame = frame_of(depth)
    alike = [
        np.corrcoef(
            faded(frame, severity, random(), SensorConfig(vignetting_k=0.0)).ravel(), frame.ravel()
        )[0, 1]
        for severity in (0.1, 0.5, 0.8, 1.0)
    ]
    assert alike[0] > 0.99
    assert sorted(alike, reverse=True) == alike
    assert abs(alike[-1]) < 0.05


@pytest.mark.parametrize("seed", range(4))
def test_bad_exposure_clips(seed: int) -> None:
    frame = frame_of("uint8")
    clipped = [
        np.isin(badly_exposed(frame, severity, random(seed)), (0, 255)).mean()
        for severity in (0.0, 0.4, 1.0)
    ]
    assert clipped[0] < clipped[1] < clipped[2]
    assert clipped[2] > 0.8


def test_frames_become_too_bright_as_well_as_too_dark() -> None:
    means = [badly_exposed(frame_of("uint8"), 0.8, random(seed)).mean() for seed in range(12)]
    assert min(means) < 60.0
    assert max(means) > 195.0
