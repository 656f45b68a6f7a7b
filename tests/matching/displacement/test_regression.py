"""Displacement networks give what they gave when they were equal to the authors'."""

import pytest
import torch
from displacement_regression import REGRESSION, images_of, network_of, outputs, stored

from uasthn_cli.matching.displacement.homography import resize_to_network

TOLERANCE_PX = 1e-3


def test_the_miniature_gives_what_it_gave() -> None:
    tensors = stored()
    found = outputs(tensors)
    kept = {name: value for name, value in tensors.items() if name.startswith("output.")}
    assert found.keys() == kept.keys()
    for name, value in found.items():
        difference_px = float((value - kept[name]).abs().max())
        assert difference_px < TOLERANCE_PX, name


def test_its_outputs_are_worth_guarding() -> None:
    tensors = stored()
    steps = tensors["output.coarse"].diff(dim=0).abs().amax(dim=(1, 2, 3))
    assert bool((steps > 0.1).all())
    assert float(tensors["output.crop_std"].min()) > 0.1
    assert float(tensors["output.ensemble_std"].max()) > 0.1
    assert not torch.allclose(tensors["output.held"], tensors["output.coarse"][-1], atol=0.1)
    assert REGRESSION.stat().st_size < 300_000


@torch.inference_mode()
@pytest.mark.parametrize(
    "layer", ["fnet1.layer2.0.downsample.0", "fnet1.conv2", "update_block_4.cnn.layer1.0"]
)
def test_a_change_of_one_layer_is_noticed(layer: str) -> None:
    tensors = stored()
    name = f"netG.{layer}.weight"
    tensors[name][:, 0] *= 1.2
    satellite, thermal = images_of(tensors)
    found = network_of(tensors).netG(resize_to_network(satellite), thermal)
    difference_px = (found.displacements - tensors["output.coarse"]).abs().max()
    assert float(difference_px) > 5 * TOLERANCE_PX
