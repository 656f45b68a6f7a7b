"""The camera: noise, fixed pattern, dead pixels, gain."""

from dataclasses import replace

import numpy as np
import pytest

from uasthn_cli.synth.kinds import Gain
from uasthn_cli.synth.noise import fractal_noise
from uasthn_cli.synth.sensor import KELVIN_PER_COUNT, SensorConfig, render_sensor
from uasthn_cli.types import ImageArray

CLEAN = SensorConfig(
    blur_px=0.0,
    netd_k=0.0,
    column_pattern_k=0.0,
    row_pattern_k=0.0,
    pixel_pattern_k=0.0,
    vignetting_k=0.0,
    dead_pixel_share=0.0,
)


@pytest.fixture(scope="module")
def scene() -> ImageArray:
    field = fractal_noise(np.random.default_rng(5), (96, 140), 1.0, 60.0)
    return (290.0 + 3.0 * field).astype(np.float32)


def test_radiometric_counts_are_kelvin(scene: ImageArray) -> None:
    config = replace(CLEAN, gain=Gain.RADIOMETRIC)
    counts = render_sensor(scene, np.random.default_rng(0), config)
    assert counts.dtype == np.uint16
    assert np.all(counts.astype(int) < 2**14)
    assert counts * KELVIN_PER_COUNT == pytest.approx(scene, abs=0.51 * KELVIN_PER_COUNT)


@pytest.mark.parametrize("gain", [Gain.PLATEAU, Gain.PERCENTILE])
def test_gain_keeps_the_order_of_temperatures(scene: ImageArray, gain: Gain) -> None:
    levels = render_sensor(scene, np.random.default_rng(0), replace(CLEAN, gain=gain))
    assert levels.dtype == np.uint8
    assert levels.shape == scene.shape
    order = np.argsort(scene, axis=None)
    assert (np.diff(levels.ravel()[order].astype(int)) >= 0).all()
    assert int(levels.max()) - int(levels.min()) > 150


@pytest.mark.parametrize("gain", [Gain.PLATEAU, Gain.PERCENTILE])
def test_gain_does_not_blow_up_a_bland_scene(gain: Gain) -> None:
    bland = np.full((80, 100), 285.0, dtype=np.float32)
    config = SensorConfig(gain=gain, dead_pixel_share=0.0)
    levels = render_sensor(bland, np.random.default_rng(1), config)
    assert 0.5 < levels.std() < 40.0


def test_noise_has_the_stated_level(scene: ImageArray) -> None:
    config = replace(CLEAN, netd_k=0.2, gain=Gain.RADIOMETRIC)
    first, second = (
        render_sensor(scene, np.random.default_rng(seed), config).astype(float) for seed in (1, 2)
    )
    assert (first - second).std() * KELVIN_PER_COUNT == pytest.approx(0.2 * np.sqrt(2), rel=0.05)


def test_fixed_pattern_stays_from_frame_to_frame(scene: ImageArray) -> None:
    config = replace(
        CLEAN, column_pattern_k=0.5, dead_pixel_share=0.002, gain=Gain.RADIOMETRIC, pattern_seed=4
    )
    residuals = [
        render_sensor(field, np.random.default_rng(seed), config) * KELVIN_PER_COUNT - field
        for seed, field in ((1, scene), (2, scene[::-1]))
    ]
    columns = [np.median(residual, axis=0) for residual in residuals]
    assert np.corrcoef(columns[0], columns[1])[0, 1] > 0.99
    other = render_sensor(scene, np.random.default_rng(1), replace(config, pattern_seed=5))
    strange = np.median(other * KELVIN_PER_COUNT - scene, axis=0)
    assert abs(np.corrcoef(columns[0], strange)[0, 1]) < 0.5


def test_dead_pixels_are_few_and_stay_put(scene: ImageArray) -> None:
    config = replace(CLEAN, dead_pixel_share=0.001, gain=Gain.RADIOMETRIC)
    frames = [render_sensor(scene, np.random.default_rng(seed), config) for seed in (1, 2)]
    dead = np.abs(frames[0] * KELVIN_PER_COUNT - scene) > 0.1
    assert 0 < dead.sum() <= round(0.001 * scene.size)
    assert (frames[0] == frames[1]).all()


def test_same_numbers_same_bytes(scene: ImageArray) -> None:
    frames = [render_sensor(scene, np.random.default_rng(9), SensorConfig()) for _ in range(2)]
    assert frames[0].tobytes() == frames[1].tobytes()
    assert scene.dtype == np.float32
