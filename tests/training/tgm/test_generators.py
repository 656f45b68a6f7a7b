"""Generators keep the image's size, and have the published number of weights."""

import pytest
import torch
from tiny_tgm import TINY_RESNET, TINY_UNET

from uasthn_cli.training.tgm.generators import (
    GeneratorArchitecture,
    GeneratorKind,
    build_generator,
)


@pytest.mark.parametrize("architecture", [TINY_UNET, TINY_RESNET])
@pytest.mark.parametrize("batch", [1, 3])
@pytest.mark.parametrize("shape_px", [(32, 96), (64, 32), (64, 64)])
def test_size_is_kept_and_values_are_bounded(
    architecture: GeneratorArchitecture, batch: int, shape_px: tuple[int, int]
) -> None:
    drawn = build_generator(architecture)(torch.rand(batch, 3, *shape_px) * 2 - 1)
    assert drawn.shape == (batch, 1, *shape_px)
    assert drawn.abs().max() <= 1


@pytest.mark.parametrize("architecture", [TINY_UNET, TINY_RESNET])
def test_images_of_a_batch_do_not_see_each_other(architecture: GeneratorArchitecture) -> None:
    network = build_generator(architecture).eval()
    batch = torch.rand(3, 3, 64, 64) * 2 - 1
    with torch.no_grad():
        assert torch.allclose(network(batch)[1:2], network(batch[1:2]), atol=1e-5)


def test_the_innermost_level_may_be_one_pixel() -> None:
    network = build_generator(TINY_UNET).train()
    assert torch.isfinite(network(torch.rand(1, 3, 32, 32))).all()


@pytest.mark.parametrize(
    ("kind", "millions"), [(GeneratorKind.UNET, 54.4), (GeneratorKind.RESNET, 11.4)]
)
def test_the_published_sizes(kind: GeneratorKind, millions: float) -> None:
    with torch.device("meta"):
        network = build_generator(GeneratorArchitecture(kind))
    assert sum(p.numel() for p in network.parameters()) / 1e6 == pytest.approx(millions, abs=0.05)


@pytest.mark.parametrize(("architecture", "stride_px"), [(TINY_UNET, 32), (TINY_RESNET, 4)])
def test_other_sizes_than_multiples_of_the_stride_do_not_come_back(
    architecture: GeneratorArchitecture, stride_px: int
) -> None:
    assert architecture.stride_px == stride_px
    network = build_generator(architecture)
    try:
        size_px = network(torch.rand(1, 3, 64, 64 + stride_px // 2)).shape[-1]
    except RuntimeError:
        return
    assert size_px != 64 + stride_px // 2
