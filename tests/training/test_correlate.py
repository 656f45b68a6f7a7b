"""The correlation by FFT against its definition, written out shift by shift."""

import torch
from torch import Tensor

from uasthn_cli.training.correlate import (
    _Correlation,
    cell_mask,
    correlate,
    normalise_template,
)

CHANNELS, WINDOW, CANVAS = 3, (17, 22), (6, 9)


def random_batch(seed: int, views: int = 2) -> tuple[Tensor, Tensor, Tensor]:
    """Return two windows, ``views`` templates in each and their masks, in double precision."""
    draw = torch.Generator().manual_seed(seed)
    window = torch.randn(2, CHANNELS, *WINDOW, generator=draw, dtype=torch.float64)
    template = torch.randn(2, views, CHANNELS, *CANVAS, generator=draw, dtype=torch.float64)
    mask = (torch.rand(2, views, 1, *CANVAS, generator=draw) > 0.3).double()
    return window, template * mask, mask


def by_definition(window: Tensor, template: Tensor, mask: Tensor) -> Tensor:
    """Return what :func:`correlate` is said to be for one window ``(C, H, W)`` and template."""
    height, width = template.shape[-2:]
    rows, columns = window.shape[-2] - height + 1, window.shape[-1] - width + 1
    scores = torch.zeros(rows, columns, dtype=window.dtype)
    for row in range(rows):
        for column in range(columns):
            under = window[:, row : row + height, column : column + width]
            energy = (under**2 * mask).sum()
            scores[row, column] = (template * under).sum() / torch.sqrt(energy + 1e-3)
    return scores


def test_scores_are_the_masked_correlation_at_every_shift() -> None:
    window, template, mask = random_batch(0)
    scores = correlate(window, template, mask)
    assert scores.shape == (2, 2, WINDOW[0] - CANVAS[0] + 1, WINDOW[1] - CANVAS[1] + 1)
    for b in range(2):
        for k in range(2):
            expected = by_definition(window[b], template[b, k], mask[b, k])
            torch.testing.assert_close(scores[b, k], expected)


def test_a_piece_of_the_window_scores_one_at_its_place() -> None:
    window, _, mask = random_batch(1, views=1)
    under = window[:, None, :, 8 : 8 + CANVAS[0], 4 : 4 + CANVAS[1]]
    count = mask.sum(dim=(-2, -1), keepdim=True)
    mean = (under * mask).sum(dim=(-2, -1), keepdim=True) / count
    flattened = window - mean[:, 0]
    template = normalise_template((under - mean)[:, 0], mask[:, 0])[:, None]
    scores = correlate(flattened, template, mask)
    torch.testing.assert_close(
        scores[:, 0, 8, 4], torch.ones(2, dtype=torch.float64), atol=1e-3, rtol=0.0
    )
    assert scores.abs().max() <= 1.0
    assert (scores.flatten(2).argmax(dim=2) == 8 * scores.shape[-1] + 4).all()


def test_gradients_are_those_of_finite_differences() -> None:
    draw = torch.Generator().manual_seed(2)
    window = torch.randn(2, 2, 7, 8, generator=draw, dtype=torch.float64, requires_grad=True)
    template = torch.randn(2, 3, 2, 4, 3, generator=draw, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(_Correlation.apply, (window, template))


def test_gradients_are_those_of_a_convolution() -> None:
    window, template, _ = random_batch(3)
    window.requires_grad_()
    template.requires_grad_()
    by_fft = _Correlation.apply(window, template)  # type: ignore[no-untyped-call]
    direct = torch.stack(
        [torch.nn.functional.conv2d(window[b : b + 1], template[b])[0] for b in range(2)]
    )
    torch.testing.assert_close(by_fft, direct)
    weights = torch.randn(direct.shape, generator=torch.Generator().manual_seed(4)).double()
    expected = torch.autograd.grad((direct * weights).sum(), [window, template])
    found = torch.autograd.grad((by_fft * weights).sum(), [window, template])
    torch.testing.assert_close(found, expected)


def test_templates_have_no_mean_unit_norm_and_nothing_outside_their_mask() -> None:
    _, template, mask = random_batch(5)
    features = template[:, 0] + 4.0
    normalised = normalise_template(features, mask[:, 0])
    torch.testing.assert_close(
        normalised.sum(dim=(2, 3)), torch.zeros(2, CHANNELS).double(), atol=1e-9, rtol=0.0
    )
    torch.testing.assert_close(
        normalised.flatten(1).norm(dim=1), torch.ones(2).double(), atol=1e-4, rtol=0.0
    )
    assert (normalised * (1 - mask[:, 0]) == 0).all()


def test_template_pixels_outside_the_mask_have_no_influence() -> None:
    _, template, mask = random_batch(6)
    soiled = template[:, 0] + 1e3 * (1 - mask[:, 0])
    torch.testing.assert_close(
        normalise_template(soiled, mask[:, 0]), normalise_template(template[:, 0], mask[:, 0])
    )


def test_an_empty_mask_gives_zeros() -> None:
    window, template, mask = random_batch(7)
    nothing = torch.zeros_like(mask)
    empty = normalise_template(template[:, 0], nothing[:, 0])[:, None]
    assert (correlate(window, empty, nothing[:, :1]).abs() < 1e-9).all()


def test_a_cell_counts_only_if_all_its_pixels_do() -> None:
    valid = torch.ones(1, 1, 6, 8)
    valid[..., 3, 5] = 0.0
    expected = torch.ones(1, 1, 3, 4)
    expected[..., 1, 2] = 0.0
    assert torch.equal(cell_mask(valid, 2), expected)
