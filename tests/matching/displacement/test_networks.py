"""Shapes, shared satellite features, early stopping and gradients of small networks."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from uasthn_cli.config import Aggregation, Sampling
from uasthn_cli.geometry.crops import crop_corners_px
from uasthn_cli.matching.displacement.agreement import (
    EarlyStop,
    crop_agreement,
    ensemble_agreement,
)
from uasthn_cli.matching.displacement.dhn import DhnArchitecture, DirectHomographyNetwork
from uasthn_cli.matching.displacement.ihn import IhnArchitecture, IterativeHomographyNetwork
from uasthn_cli.matching.displacement.sthn import TwoStageHomographyNetwork

SMALL = IhnArchitecture(block_widths=(8, 8), feature_channels=8, update_channels=8)
SMALL_SECOND = IhnArchitecture(2, False, (8, 8), 8, 8)

Network = IterativeHomographyNetwork | DirectHomographyNetwork


def ihn() -> IterativeHomographyNetwork:
    torch.manual_seed(1)
    return IterativeHomographyNetwork(SMALL).eval()


def dhn() -> DirectHomographyNetwork:
    torch.manual_seed(1)
    return DirectHomographyNetwork(DhnArchitecture((8, 8, 8, 8, 8), 16)).eval()


def images(count: int, seed: int) -> Tensor:
    torch.manual_seed(seed)
    return torch.rand(count, 3, 256, 256)


def crops(views: int) -> Tensor:
    rng = np.random.default_rng(0)
    corners = crop_corners_px((256, 256), views, (16.0, 16.0), Sampling.RANDOM, rng)
    return torch.from_numpy(corners).float()


@torch.inference_mode()
@pytest.mark.parametrize("build", [ihn, dhn])
@pytest.mark.parametrize("samples", [1, 3])
def test_shapes_and_independence_of_the_batch(build: Callable[[], Network], samples: int) -> None:
    network = build()
    satellite, thermal = images(samples, 2), images(samples, 3)
    found = network(satellite, thermal, 2)
    steps = 2 if network.is_iterative else 1
    assert found.displacements.shape == (steps, samples, 4, 2)
    assert found.log_variances is None
    alone = network(satellite[-1:], thermal[-1:], 2)
    assert torch.allclose(alone.last, found.last[-1:], atol=1e-3)


@torch.inference_mode()
def test_a_second_head_of_dhn_leaves_the_answers_and_models_their_deviations() -> None:
    torch.manual_seed(1)
    size = DhnArchitecture((8, 8, 8, 8, 8), 16, has_uncertainty_head=True)
    modelling = DirectHomographyNetwork(size).eval()
    satellite, thermal = images(2, 2), images(2, 3)
    found = modelling(satellite, thermal)
    assert torch.equal(found.displacements, dhn()(satellite, thermal).displacements)
    last = modelling.ue_head.get_submodule("4")
    last.get_parameter("weight").zero_()
    last.get_parameter("bias").copy_(2.0 * torch.arange(1.0, 9.0).log())
    deviations = modelling(satellite, thermal).deviations
    assert deviations is not None
    # a first guess of 1 is an output's unit, 32 px
    assert torch.allclose(deviations, 32.0 * torch.arange(1.0, 9.0).reshape(4, 2).expand(2, 4, 2))


@torch.inference_mode()
@pytest.mark.parametrize("build", [ihn, dhn])
@pytest.mark.parametrize("views", [2, 3, 6])
def test_crops_agree_on_any_number_of_views(build: Callable[[], Network], views: int) -> None:
    network = build()
    satellite, thermal = images(2, 4), images(2, 5)
    features = network.encode_satellite(satellite)
    found = crop_agreement(network, features, thermal, crops(views), 2)
    assert found.samples.shape == (views, 2, 4, 2)
    assert found.std.shape == (2, 4, 2)
    assert torch.allclose(found.original, network(satellite, thermal, 2).last, atol=1e-3)
    assert torch.allclose(found.samples[0], found.original, atol=1e-3)
    mean = found.answer(Aggregation.MEAN)
    assert torch.allclose(mean, found.samples.mean(dim=0))


def test_views_one_by_one_and_together_are_equal() -> None:
    network = ihn()
    satellite, thermal = images(1, 6), images(1, 7)
    features = network.encode_satellite(satellite)
    together = crop_agreement(network, features, thermal, crops(3), 2)
    assert together.samples.requires_grad
    with torch.inference_mode():
        apart = crop_agreement(network, features.detach(), thermal, crops(3), 2)
    assert torch.allclose(together.samples, apart.samples, atol=1e-3)


@torch.inference_mode()
def test_early_stopping_changes_the_answer_only_where_lookups_are_held() -> None:
    network = ihn()
    network.state_dict()["update_block_4.cnn.layer10.3.weight"].mul_(30.0)
    satellite, thermal = images(1, 8), images(1, 9)
    features = network.encode_satellite(satellite)
    whole = crop_agreement(network, features, thermal, crops(2), 4)
    stopped = crop_agreement(network, features, thermal, crops(2), 4, EarlyStop(1))
    held = crop_agreement(
        network, features, thermal, crops(2), 4, EarlyStop(1, is_lookup_held=True)
    )
    assert torch.allclose(stopped.original, whole.original, atol=1e-3)
    assert not torch.allclose(held.original, whole.original, atol=1e-1)
    assert torch.equal(stopped.std, held.std)
    assert not torch.allclose(stopped.std, whole.std, atol=1e-2)
    with pytest.raises(ValueError, match="aggregate by the original"):
        stopped.answer(Aggregation.MEAN)


def test_what_makes_no_sense_is_refused() -> None:
    thermal = images(1, 10)
    with pytest.raises(ValueError, match="at least two views"):
        crop_agreement(dhn(), thermal, thermal, crops(2)[:1])
    with pytest.raises(ValueError, match="several steps"):
        crop_agreement(dhn(), thermal, thermal, crops(2), stop=EarlyStop(1))
    with pytest.raises(ValueError, match="after 7 of 6 steps"):
        crop_agreement(ihn(), thermal, thermal, crops(2), stop=EarlyStop(7))
    with pytest.raises(ValueError, match="at least two networks"):
        ensemble_agreement([dhn()], thermal, thermal)
    with pytest.raises(ValueError, match="cannot go on"):
        dhn().refine(dhn().pair(thermal, thermal), start=torch.zeros(1, 4, 2))


@torch.inference_mode()
def test_members_of_an_ensemble() -> None:
    first, second = dhn(), dhn()
    second.state_dict()["head.4.bias"].add_(0.25)
    satellite, thermal = images(1, 11), images(1, 12)
    found = ensemble_agreement([first, second], satellite, thermal)
    assert torch.allclose(found.answer(Aggregation.MEAN) - found.original, torch.tensor(4.0))
    assert torch.allclose(found.std, torch.tensor(8.0 / 2**0.5))


def test_both_stages_and_the_head_can_be_trained() -> None:
    torch.manual_seed(3)
    first = IhnArchitecture(4, True, (8, 8), 8, 8)
    network = TwoStageHomographyNetwork(first, SMALL_SECOND)
    coarse, second = network(torch.rand(1, 3, 300, 300), images(1, 13), 2)
    assert coarse.log_variances is not None
    assert second.displacement.shape == (1, 4, 2)
    (second.displacement.abs().sum() + coarse.log_variances.abs().sum()).backward()
    assert all(value.grad is not None for value in network.parameters())
