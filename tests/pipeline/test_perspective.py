"""A tilt is read off how a frame's parts lie on the map."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.pipeline import perspective
from uasthn_cli.types import Attitude, CameraModel, FrameFile, Prior

CAMERA = CameraModel(640, 512, 770.0, 770.0, 319.5, 255.5, mount_yaw_rad=0.4)
ANGLES = st.floats(-0.06, 0.06)


def prior(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Prior:
    attitude = Attitude(roll_rad, pitch_rad, yaw_rad)
    return Prior(FrameFile("a.png", Path("a.png")), 0.0, 46.0, 7.0, 260.0, attitude, "given")


def test_parts_cover_the_frame() -> None:
    parts = perspective._parts_px(640, 512)
    assert parts.shape == (9, 4, 2)
    assert parts[0, 0].tolist() == [-0.5, -0.5]
    assert parts[-1, -1].tolist() == [639.5, 511.5]
    assert parts.mean(axis=(0, 1)).tolist() == pytest.approx([319.5, 255.5])


@given(ANGLES, ANGLES, st.floats(-3.0, 3.0), ANGLES, ANGLES)
def test_a_tilt_that_moves_the_parts_is_found(
    roll: float, pitch: float, yaw: float, more_roll: float, more_pitch: float
) -> None:
    """Beside a shift, a turn and a growth, all small."""
    design = perspective._design(
        CAMERA, prior(roll, pitch, yaw), perspective._parts_px(640, 512).mean(axis=1)
    )
    assert design.shape == (18, 6)
    values = np.array([more_roll, more_pitch, 0.01, -0.02, 3.0, -2.0])
    found = perspective._fitted(design, design @ values)
    assert found.angles_rad == pytest.approx(values[:2], abs=1e-6)


def test_a_part_found_far_off_counts_little() -> None:
    design = perspective._design(
        CAMERA, prior(0.0, 0.0, 1.0), perspective._parts_px(640, 512).mean(axis=1)
    )
    rng = np.random.default_rng(1)
    moved_m = design @ np.array([0.0, 0.04, 0.0, 0.0, 1.0, 1.0]) + rng.normal(0, 0.2, 18)
    moved_m[4] += 12.0
    found = perspective._fitted(design, moved_m)
    deviations = np.sqrt(np.diag(found.covariance_rad2))
    assert (np.abs(found.angles_rad - [0.0, 0.04]) < 3 * deviations).all()
    assert deviations.max() < math.radians(3.0)
