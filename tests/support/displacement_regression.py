"""A miniature of ../shared/parity: small random networks, small images, and what they gave.

    python tests/support/displacement_regression.py

writes ``tests/matching/displacement/regression.safetensors`` anew. The code that wrote it was equal
to the authors' outputs (``test_parity.py``), so the file guards that equality where ../shared is
absent. Write it again only together with a parity run.
"""

from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor
from torch.nn import functional

from uasthn_cli.config import Aggregation
from uasthn_cli.matching.displacement.agreement import (
    EarlyStop,
    crop_agreement,
    ensemble_agreement,
)
from uasthn_cli.matching.displacement.homography import resize_to_network
from uasthn_cli.matching.displacement.ihn import IhnArchitecture, IterativeHomographyNetwork
from uasthn_cli.matching.displacement.sthn import TwoStageHomographyNetwork

REGRESSION = Path(__file__).parents[1] / "matching" / "displacement" / "regression.safetensors"

FIRST = IhnArchitecture(
    has_uncertainty_head=True, block_widths=(8, 8), feature_channels=16, update_channels=8
)
SECOND = IhnArchitecture(levels=2, block_widths=(8, 8), feature_channels=16, update_channels=8)
CROPS = ((0, 0, 255), (13, 4, 239), (0, 16, 239))
"""Left, top and span of each view in pixels at W_R."""

SATELLITE_WIDTH_PX = 512
_SEED, _GAIN, _MEMBER_GAIN = 4, 6.0, 0.9
_LAST_LAYERS = ("update_block_4.cnn.layer10.3.weight", "ue_update_block_4.cnn.layer10.3.weight")


def stored() -> dict[str, Tensor]:
    """Return the file's tensors as float32."""
    return {name: value.float() for name, value in load_file(REGRESSION).items()}


def network_of(tensors: dict[str, Tensor]) -> TwoStageHomographyNetwork:
    """Return both stages with the weights among the tensors."""
    network = TwoStageHomographyNetwork(FIRST, SECOND)
    weights = {name: value for name, value in tensors.items() if name.startswith("netG")}
    network.load_state_dict(weights)
    return network.eval()


def images_of(tensors: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
    """Return satellite ``(1, 3, 512, 512)`` and thermal ``(1, 3, 256, 256)`` in 0..1."""
    satellite, thermal = (
        functional.interpolate(tensors[name][None] / 255.0, scale_factor=8, mode="bilinear")
        for name in ("input.satellite", "input.thermal")
    )
    return satellite, thermal.expand(1, 3, -1, -1)


@torch.inference_mode()
def outputs(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Return what the networks give for the images, by name."""
    network = network_of(tensors)
    satellite, thermal = images_of(tensors)
    small = resize_to_network(satellite)
    coarse, second = network(satellite, thermal)
    features = network.netG.encode_satellite(small)
    corners = torch.tensor(
        [[[x, y], [x + s, y], [x, y + s], [x + s, y + s]] for x, y, s in CROPS]
    ).float()
    all_steps = crop_agreement(network.netG, features, thermal, corners)
    held = crop_agreement(
        network.netG, features, thermal, corners, stop=EarlyStop(3, is_lookup_held=True)
    )
    pair = [network.netG, _weaker(network.netG)]
    members = ensemble_agreement(pair, small, thermal)
    assert coarse.deviations is not None
    return {
        "output.coarse": coarse.displacements,
        "output.deviations": coarse.deviations,
        "output.boxes": second.boxes_px,
        "output.two_stage": second.displacement,
        "output.crop_std": all_steps.std,
        "output.held_std": held.std,
        "output.held": held.answer(Aggregation.ORIGINAL),
        "output.ensemble_std": members.std,
        "output.ensemble_mean": members.answer(Aggregation.MEAN),
    }


def _weaker(network: IterativeHomographyNetwork) -> IterativeHomographyNetwork:
    """Return a second member: smaller steps."""
    other = IterativeHomographyNetwork(network.architecture)
    weights = network.state_dict()
    other.load_state_dict(weights | {_LAST_LAYERS[0]: weights[_LAST_LAYERS[0]] * _MEMBER_GAIN})
    return other.eval()


def _write() -> None:
    torch.manual_seed(_SEED)
    network = TwoStageHomographyNetwork(FIRST, SECOND)
    weights = {
        name: (value * _GAIN if name.endswith(_LAST_LAYERS) else value).half()
        for name, value in network.state_dict().items()
    }
    inputs = {
        "input.satellite": torch.randint(0, 256, (3, 64, 64), dtype=torch.uint8),
        "input.thermal": torch.randint(0, 256, (1, 32, 32), dtype=torch.uint8),
    }
    tensors = {**weights, **inputs}
    given = outputs({name: value.float() for name, value in tensors.items()})
    save_file(tensors | {name: value.contiguous() for name, value in given.items()}, REGRESSION)


if __name__ == "__main__":
    _write()
