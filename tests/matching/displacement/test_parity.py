"""The authors' outputs for random weights, from ../shared/parity, against ours in float32.

Both files hold weights rounded to float16. The outputs of ``uasthn_uncertainty.pt`` come from those
weights; the outputs of ``uasthn_two_stage.pt`` from weights whose last layer was multiplied by 6
after rounding, and then rounded once more for the file. That layer is made again here from the
file's seed, and must round to what the file holds.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from uasthn_cli.config import Aggregation
from uasthn_cli.matching.displacement.agreement import (
    EarlyStop,
    crop_agreement,
    ensemble_agreement,
)
from uasthn_cli.matching.displacement.homography import (
    recover_displacement,
    resize_to_network,
    sample_boxes,
    square_corners,
)
from uasthn_cli.matching.displacement.ihn import IhnArchitecture, IterativeHomographyNetwork
from uasthn_cli.matching.displacement.sthn import TwoStageHomographyNetwork

pytestmark = pytest.mark.slow

TOLERANCE_PX = 1e-3
SEED, LAST_LAYER_GAIN = 20, 6.0
LAST_LAYER = "update_block_4.cnn.layer10.3.weight"
MEMBER_GAINS = (1.0, 0.9, 1.1)

Stored = dict[str, Any]


def corner_list(stored: Tensor) -> Tensor:
    """Return displacements ``(..., 4, 2)`` from the authors' ``(..., xy, row, column)``."""
    return stored.flatten(-2).mT


def largest(found: Tensor, stored: Tensor) -> float:
    """Return the largest difference to stored displacements, in pixels."""
    return float((found - corner_list(stored)).abs().max())


def as_float(weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name: value.float() for name, value in weights.items()}


@pytest.fixture(scope="module")
def folder(shared_dir: Path) -> Path:
    if not (shared_dir / "parity").is_dir():
        pytest.skip("../shared/parity is not here")
    return shared_dir / "parity"


@pytest.fixture(scope="module")
def two_stage(folder: Path) -> Stored:
    stored: Stored = torch.load(folder / "uasthn_two_stage.pt", weights_only=True)
    return stored


@pytest.fixture(scope="module")
def uncertainty(folder: Path) -> Stored:
    stored: Stored = torch.load(folder / "uasthn_uncertainty.pt", weights_only=True)
    return stored


@pytest.fixture(scope="module")
def satellite(two_stage: Stored) -> Tensor:
    pixels: Tensor = two_stage["satellite_u8"]
    return pixels.permute(2, 0, 1)[None].float() / 255.0


@pytest.fixture(scope="module")
def thermal(two_stage: Stored) -> Tensor:
    pixels: Tensor = two_stage["thermal_u8"]
    return (pixels.float() / 255.0).expand(1, 3, -1, -1)


@pytest.fixture(scope="module")
def network(two_stage: Stored) -> TwoStageHomographyNetwork:
    """Both stages with the weights of the file."""
    both = TwoStageHomographyNetwork()
    both.netG.load_state_dict(as_float(two_stage["netG"]))
    both.netG_fine.load_state_dict(as_float(two_stage["netG_fine"]))
    return both.eval()


@pytest.fixture(scope="module")
def demo_network(two_stage: Stored) -> TwoStageHomographyNetwork:
    """Both stages with the last layers that the demonstration ran with."""
    torch.manual_seed(SEED)
    both = TwoStageHomographyNetwork()
    for stage, stored in ((both.netG, two_stage["netG"]), (both.netG_fine, two_stage["netG_fine"])):
        exact = stage.state_dict()[LAST_LAYER].half().float() * LAST_LAYER_GAIN
        assert torch.equal(exact.half(), stored[LAST_LAYER])
        stage.load_state_dict(as_float(stored) | {LAST_LAYER: exact})
    return both.eval()


@pytest.fixture(scope="module")
def satellite_features(network: TwoStageHomographyNetwork, satellite: Tensor) -> Tensor:
    with torch.inference_mode():
        return network.netG.encode_satellite(resize_to_network(satellite))


@torch.inference_mode()
def test_both_stages(
    two_stage: Stored, demo_network: TwoStageHomographyNetwork, satellite: Tensor, thermal: Tensor
) -> None:
    coarse, second = demo_network(satellite, thermal)
    stored = two_stage["coarse_per_iteration"].movedim(1, 0)
    assert largest(coarse.displacements, stored) < TOLERANCE_PX
    assert largest(coarse.last, two_stage["coarse"]) < TOLERANCE_PX
    moved = second.boxes_px - square_corners(1536, satellite)
    assert largest(moved, two_stage["refine_bbox"]) < TOLERANCE_PX
    side_px = float(second.boxes_px[0, 3, 0] - second.boxes_px[0, 0, 0]) + 1.0
    assert side_px / 256.0 == pytest.approx(float(two_stage["refine_delta"]), abs=1e-5)
    box = sample_boxes(satellite, second.boxes_px)
    found = torch.stack([box.mean(), box.std()])
    assert torch.allclose(found, two_stage["refine_crop_mean_std"], atol=1e-6)
    assert largest(second.displacement, two_stage["two_stage"]) < TOLERANCE_PX


@torch.inference_mode()
def test_crops_through_both_stages(
    two_stage: Stored, demo_network: TwoStageHomographyNetwork, satellite: Tensor, thermal: Tensor
) -> None:
    last, crop = square_corners(256, thermal), square_corners(256 - 32, thermal)
    places = torch.tensor([[0.0, 32.0], [0.0, 0.0], [32.0, 0.0], [32.0, 32.0]])
    corners = torch.cat([last[None], crop + places[:, None]])
    found = []
    for box in corners:
        _, second = demo_network(satellite, sample_boxes(thermal, box[None]))
        found.append(second.displacement)
    recovered = recover_displacement(corners, torch.cat(found))
    assert largest(recovered[0], two_stage["croptta_grid5_shift32_pred"][0]) < TOLERANCE_PX
    std = two_stage["croptta_grid5_shift32_std"][0]
    assert largest(recovered.std(dim=0), std) < TOLERANCE_PX


@torch.inference_mode()
@pytest.mark.parametrize("sampling", ["grid", "random"])
@pytest.mark.parametrize("stop", [-1, 2])
def test_crops_of_the_first_stage(
    uncertainty: Stored,
    network: TwoStageHomographyNetwork,
    satellite: Tensor,
    thermal: Tensor,
    satellite_features: Tensor,
    sampling: str,
    stop: int,
) -> None:
    key = f"croptta_{sampling}5_offset32_stop{stop}_"
    early = None if stop < 0 else EarlyStop(stop + 1, is_lookup_held=True)
    found = crop_agreement(
        network.netG,
        satellite_features,
        thermal,
        uncertainty[key + "crop_corners_256px"],
        stop=early,
    )
    assert largest(found.std, uncertainty[key + "std"]) < TOLERANCE_PX
    answer = found.answer(Aggregation.ORIGINAL)
    second = network.look_again(satellite, thermal, answer)
    assert largest(second.displacement, uncertainty[key + "two_stage"]) < TOLERANCE_PX
    if (sampling, stop) == ("random", -1):
        one = "croptta_random5_offset32_one_stage"
        assert largest(answer, uncertainty[one]) < TOLERANCE_PX
        assert largest(found.std, uncertainty[one + "_std"]) < TOLERANCE_PX


@torch.inference_mode()
def test_direct_modeling(
    uncertainty: Stored, two_stage: Stored, satellite: Tensor, thermal: Tensor
) -> None:
    network = IterativeHomographyNetwork(IhnArchitecture(has_uncertainty_head=True)).eval()
    head = as_float(uncertainty["direct_modeling_extra_weights"])
    network.load_state_dict(as_float(two_stage["netG"]) | head)
    found = network(resize_to_network(satellite), thermal)
    assert found.deviations is not None
    assert largest(found.last, uncertainty["direct_modeling_pred"]) < TOLERANCE_PX
    assert largest(found.deviations, uncertainty["direct_modeling_std"]) < TOLERANCE_PX


@torch.inference_mode()
@pytest.mark.parametrize("stop", [-1, 2])
def test_an_ensemble(
    uncertainty: Stored, two_stage: Stored, satellite: Tensor, thermal: Tensor, stop: int
) -> None:
    members = []
    for gain in MEMBER_GAINS:
        member = IterativeHomographyNetwork()
        base = as_float(two_stage["netG"])
        member.load_state_dict(base | {LAST_LAYER: base[LAST_LAYER] * gain})
        members.append(member.eval())
    early = None if stop < 0 else EarlyStop(stop + 1)
    found = ensemble_agreement(members, resize_to_network(satellite), thermal, stop=early)
    assert largest(found.std, uncertainty[f"ensemble3_stop{stop}_std"]) < TOLERANCE_PX
    aggregation = Aggregation.MEAN if stop < 0 else Aggregation.ORIGINAL
    answer = found.answer(aggregation)
    assert largest(answer, uncertainty[f"ensemble3_stop{stop}_pred_mean"]) < TOLERANCE_PX
