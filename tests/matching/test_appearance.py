"""Brightness and edges: masked correlation against a direct computation, and what it is worth."""

import cv2
import numpy as np
import pytest
from small_flight import ground_texture

from uasthn_cli.matching.appearance import (
    CHANNELS,
    AppearanceKernels,
    appearance_cells,
    appearance_kernels,
    appearance_scores,
    levelled_window,
    masked_correlation,
)
from uasthn_cli.matching.ncc import CELLS_PER_SAMPLE, LARGEST_CORRELATION
from uasthn_cli.types import FloatArray, ImageArray

ROWS, COLUMNS = 21, 30
HEIGHT, WIDTH = 9, 14


def scene(seed: int = 0) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return window ``(2, H, W)``, valid ``(H, W)``, template ``(2, h, w)``, three masks."""
    random = np.random.default_rng(seed)
    window = random.normal(3.0, 2.0, (2, ROWS, COLUMNS))
    template = window[:, 5 : 5 + HEIGHT, 11 : 11 + WIDTH] + random.normal(
        0.0, 0.5, (2, HEIGHT, WIDTH)
    )
    masks = np.ones((3, HEIGHT, WIDTH))
    masks[1, :, :6] = 0.0
    masks[2] = random.random((HEIGHT, WIDTH)) < 0.6
    return window, np.ones((ROWS, COLUMNS)), template, masks


def directly(
    window: FloatArray, valid: FloatArray, template: FloatArray, masks: FloatArray
) -> FloatArray:
    """Return Pearson's correlation at every shift, window by window."""
    rows, columns = ROWS - HEIGHT + 1, COLUMNS - WIDTH + 1
    found = np.zeros((len(masks), len(window), rows, columns))
    for channel, layer in enumerate(window):
        filled = np.where(valid > 0, layer, layer[valid > 0].mean())
        for index, mask in enumerate(masks):
            inside = mask > 0
            for j, i in np.ndindex(rows, columns):
                piece = filled[j : j + HEIGHT, i : i + WIDTH][inside]
                found[index, channel, j, i] = np.corrcoef(piece, template[channel][inside])[0, 1]
    return found


def seen(
    window: FloatArray, valid: FloatArray, template: FloatArray, masks: FloatArray
) -> tuple[ImageArray, AppearanceKernels]:
    """Return a scene as the search has it: the window levelled, all in single precision."""
    levelled = levelled_window(window.astype(np.float32), valid > 0)
    return levelled, appearance_kernels(template.astype(np.float32), masks.astype(np.float32))


@pytest.mark.parametrize("seed", range(3))
def test_convention_it_is_pearsons_correlation_under_each_mask(seed: int) -> None:
    """Rows and columns differ in number: entry ``(j, i)`` lays cell (0, 0) on ``(j, i)``."""
    window, valid, template, masks = scene(seed)
    found = masked_correlation(*seen(window, valid, template, masks))
    assert found.shape == (3, 2, ROWS - HEIGHT + 1, COLUMNS - WIDTH + 1)
    assert found == pytest.approx(directly(window, valid, template, masks), abs=1e-4)
    assert np.unravel_index(found[0, 0].argmax(), found[0, 0].shape) == (5, 11)


def test_cells_off_the_map_count_as_its_mean() -> None:
    window, valid, template, masks = scene()
    valid[:, 24:], valid[:3] = 0.0, 0.0
    expected = directly(window, valid, template, masks)
    spoiled = np.where(valid > 0, window, 1e3)
    for shown in (window, spoiled):
        found = masked_correlation(*seen(shown, valid, template, masks))
        assert found == pytest.approx(expected, abs=1e-3)


def test_brightness_and_contrast_of_either_side_do_not_matter() -> None:
    window, valid, template, masks = scene()
    plain = masked_correlation(*seen(window, valid, template, masks))
    changed = masked_correlation(*seen(40 + 3 * window, valid, 0.1 * template, masks))
    assert changed == pytest.approx(plain, abs=1e-4)


def test_flat_ground_and_flat_frames_correlate_with_nothing() -> None:
    window, valid, template, masks = scene()
    window[:, :, :WIDTH] = 3.0
    on_flat = masked_correlation(*seen(window, valid, template, masks))[..., 0]
    flat_frame = masked_correlation(*seen(window, valid, 0 * template + 2, masks))
    nothing_shown = masked_correlation(*seen(window, valid, template, 0 * masks))
    assert np.abs(on_flat).max() < 0.02
    assert np.abs(flat_frame).max() < 1e-3
    assert np.abs(nothing_shown).max() < 1e-3


def test_scores_are_the_log_likelihood_of_both_channels() -> None:
    window, valid, template, masks = scene()
    correlation = directly(window, valid, template, masks)
    clipped = np.clip(correlation, -LARGEST_CORRELATION, LARGEST_CORRELATION)
    samples = masks.sum(axis=(1, 2))[:, None, None] / CELLS_PER_SAMPLE
    expected = -0.5 * samples * np.log1p(-(clipped**2)).sum(axis=1)
    found = appearance_scores(*seen(window, valid, template, masks))
    assert found == pytest.approx(expected, abs=1e-3)


def test_inverted_contrast_scores_alike() -> None:
    window, valid, template, masks = scene()
    day = appearance_scores(*seen(window, valid, template, masks))
    night = appearance_scores(*seen(window, valid, -template, masks))
    assert night == pytest.approx(day, abs=1e-5)


def test_a_perfect_fit_is_worth_a_bounded_amount() -> None:
    window, valid, _, masks = scene()
    exact = window[:, 5 : 5 + HEIGHT, 11 : 11 + WIDTH]
    scores = appearance_scores(*seen(window, valid, exact, masks))
    bound = -HEIGHT * WIDTH / CELLS_PER_SAMPLE * np.log1p(-(LARGEST_CORRELATION**2))
    assert float(scores[0].max()) == pytest.approx(bound, rel=1e-3)


def test_cells_are_means_of_brightness_and_of_gradient() -> None:
    grey = (ground_texture(2)[:64, :96] / 255.0).astype(np.float32)
    valid = np.ones(grey.shape, np.bool_)
    cells = appearance_cells(grey, valid, 2)
    assert cells.shape == (len(CHANNELS), 32, 48)
    assert cells.dtype == np.float32
    assert cells[0] == pytest.approx(grey.reshape(32, 2, 48, 2).mean(axis=(1, 3)), abs=1e-6)
    slopes = [cv2.Sobel(grey, cv2.CV_32F, *axis) for axis in ((1, 0), (0, 1))]
    gradient = np.hypot(*slopes).reshape(32, 2, 48, 2).mean(axis=(1, 3))
    assert cells[1] == pytest.approx(gradient, abs=1e-5)


def test_an_edge_between_valid_and_not_is_no_gradient() -> None:
    grey = np.full((32, 32), 0.8, np.float32)
    valid = np.ones(grey.shape, np.bool_)
    grey[:, 20:], valid[:, 20:] = 0.0, False
    cells = appearance_cells(grey, valid, 2)
    assert np.abs(cells[1]).max() < 1e-6
