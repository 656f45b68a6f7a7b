"""The correlation against its definition and against the one that training differentiates."""

import numpy as np
import pytest
import torch

from uasthn_cli.matching import correlate as module
from uasthn_cli.matching.correlate import (
    Kernels,
    correlate,
    correlate_directly,
    normalise_template,
    template_kernels,
)
from uasthn_cli.training import correlate as training
from uasthn_cli.types import ImageArray

CHANNELS, WINDOW, CANVAS = 3, (37, 52), (6, 9)


def scene(seed: int, views: int = 2) -> tuple[ImageArray, ImageArray, ImageArray]:
    """Return a window, features of a frame, and masks of views of it."""
    draw = np.random.default_rng(seed)
    window = draw.normal(size=(CHANNELS, *WINDOW)).astype(np.float32)
    features = draw.normal(1.0, 1.0, size=(CHANNELS, *CANVAS)).astype(np.float32)
    return window, features, (draw.random((views, *CANVAS)) > 0.3).astype(np.float32)


def by_torch(window: ImageArray, features: ImageArray, masks: ImageArray) -> ImageArray:
    mask = torch.from_numpy(masks)[:, None]
    repeated = torch.from_numpy(features).expand(len(masks), -1, -1, -1)
    template = training.normalise_template(repeated, mask)
    scores = training.correlate(torch.from_numpy(window)[None], template[None], mask[None])
    array: ImageArray = scores[0].numpy()
    return array


def test_scores_are_those_of_training() -> None:
    window, features, masks = scene(0)
    found = correlate(window, template_kernels(features, masks))
    assert found.shape == (2, WINDOW[0] - CANVAS[0] + 1, WINDOW[1] - CANVAS[1] + 1)
    assert found.dtype == np.float32
    assert found == pytest.approx(by_torch(window, features, masks), abs=1e-5)


@pytest.mark.parametrize("largest", [1, 13, 20, 40])
def test_blocks_of_any_size_give_the_same(largest: int, monkeypatch: pytest.MonkeyPatch) -> None:
    window, features, masks = scene(1)
    whole = correlate(window, template_kernels(features, masks))
    monkeypatch.setattr(module, "_LARGEST_BLOCK", largest)
    assert correlate(window, template_kernels(features, masks)) == pytest.approx(whole, abs=1e-5)


def test_sums_are_of_the_pairs_that_are_named() -> None:
    window, features, _ = scene(2)
    pairs = [(slice(0, 2), slice(1, 3)), (slice(2, 3), slice(0, 1))]
    sums = Kernels(features[None]).sums(window, pairs)
    assert sums.shape[:2] == (1, 2)
    under = window[:, 7 : 7 + CANVAS[0], 11 : 11 + CANVAS[1]]
    expected = float((under[0:2] * features[1:3]).sum()), float((under[2] * features[0]).sum())
    assert sums[0, :, 7, 11] == pytest.approx(expected, abs=1e-4)


def test_templates_have_no_mean_unit_norm_and_nothing_outside_their_mask() -> None:
    _, features, masks = scene(3)
    templates = normalise_template(features, masks)
    assert templates.sum(axis=(2, 3)) == pytest.approx(0.0, abs=1e-5)
    assert np.linalg.norm(templates.reshape(2, -1), axis=1) == pytest.approx(1.0, abs=1e-4)
    assert (templates * (1 - masks[:, None]) == 0).all()


def test_an_empty_mask_gives_zeros() -> None:
    window, features, masks = scene(4)
    scores = correlate(window, template_kernels(features, 0 * masks))
    assert np.abs(scores).max() < 1e-4


def test_a_few_shifts_are_scored_directly_like_all_of_them() -> None:
    window, features, masks = scene(5, views=3)
    templates = normalise_template(features, masks)
    found = correlate_directly(window, templates, masks)
    expected = correlate(window, template_kernels(features, masks))
    assert found == pytest.approx(expected, abs=1e-5)


def test_kernels_serve_windows_of_one_size_and_another() -> None:
    window, features, masks = scene(6)
    kernels = template_kernels(features, masks)
    for columns in (slice(0, 30), slice(9, 39), slice(0, 52)):
        part = np.ascontiguousarray(window[..., columns])
        expected = correlate(part, template_kernels(features, masks))
        np.testing.assert_array_equal(correlate(part, kernels), expected)
