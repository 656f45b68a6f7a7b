"""The discriminator judges patches of 70 px."""

import torch

from uasthn_cli.training.tgm.discriminator import PATCH_PX, PatchDiscriminator


def test_cells_cover_the_image() -> None:
    logits = PatchDiscriminator(4)(torch.rand(3, 3, 256, 128), torch.rand(3, 1, 256, 128))
    assert logits.shape == (3, 1, 30, 14)


def test_a_cell_sees_a_patch_of_70_px_of_both_images() -> None:
    network = PatchDiscriminator(4)
    for name, module in list(network.layers.named_children()):
        if isinstance(module, torch.nn.InstanceNorm2d):  # sees everything; not what is tested
            setattr(network.layers, name, torch.nn.Identity())
    rgb = torch.rand(1, 3, 256, 256, requires_grad=True)
    thermal = torch.rand(1, 1, 256, 256, requires_grad=True)
    network(rgb, thermal)[0, 0, 15, 12].backward()
    for image in (rgb, thermal):
        assert image.grad is not None
        seen = image.grad[0].abs().sum(dim=0) > 0
        rows, columns = seen.any(dim=1).nonzero(), seen.any(dim=0).nonzero()
        assert rows.max() - rows.min() + 1 == PATCH_PX
        assert columns.max() - columns.min() + 1 == PATCH_PX
