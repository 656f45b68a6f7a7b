"""How crops of one image, or several networks, agree on a displacement (paper, sec. III)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from uasthn_cli.config import Aggregation
from uasthn_cli.matching.displacement.homography import recover_displacement, sample_boxes
from uasthn_cli.matching.displacement.ihn import ITERATIONS
from uasthn_cli.matching.displacement.network import DisplacementNetwork


@dataclass(frozen=True, slots=True)
class EarlyStop:
    """All views for ``all_views`` steps, then one of them alone (paper, "early stopping").

    The authors' CropTTA holds the places looked at from there on, which changes its answers; with
    ``is_lookup_held`` ours does too, for the sake of equal numbers. Their ``stop = 2`` is
    ``all_views = 3``.
    """

    all_views: int
    is_lookup_held: bool = False


@dataclass(frozen=True, slots=True)
class Agreement:
    """``samples`` ``(N, B, 4, 2)``: displacements of the whole image by each view or network.

    ``original`` ``(B, 4, 2)`` is the first one's after all steps: it went on where the others were
    stopped early (``is_stopped``). ``modelled_std`` ``(B, 4, 2)`` is the deviation that a Direct
    Modeling head gives the original, None without one. All in pixels of W_R.
    """

    samples: Tensor
    original: Tensor
    is_stopped: bool = False
    modelled_std: Tensor | None = None

    @property
    def std(self) -> Tensor:
        """Unbiased standard deviation ``(B, 4, 2)`` among the samples (paper, eqs. 6 and 10)."""
        return self.samples.std(dim=0)

    def answer(self, aggregation: Aggregation) -> Tensor:
        """Return the displacement ``(B, 4, 2)``: the original's, or the mean of all samples.

        Raises:
            ValueError: a mean over samples that were stopped early.
        """
        if aggregation is Aggregation.ORIGINAL:
            return self.original
        if self.is_stopped:
            raise ValueError("early stopping leaves one view to answer: aggregate by the original")
        return self.samples.mean(dim=0)


def crop_agreement(
    network: DisplacementNetwork,
    satellite_features: Tensor,
    thermal: Tensor,
    crop_corners: Tensor,
    iterations: int = ITERATIONS,
    stop: EarlyStop | None = None,
) -> Agreement:
    """Locate crops of thermal images ``(B, 3, 256, 256)`` and carry them back to the whole image.

    ``crop_corners`` ``(N, 4, 2)``, N at least 2, are corners at W_R, the whole image's first (see
    :func:`uasthn_cli.geometry.crops.crop_corners_px`).

    Raises:
        ValueError: fewer than two views, or early stopping of a network without steps.
    """
    views, samples = len(crop_corners), len(thermal)
    if views < 2:
        raise ValueError("CropTTA needs at least two views: the whole image and one crop")
    steps = _steps_together(network, iterations, stop)
    crops = [sample_boxes(thermal, box.expand(samples, -1, -1)) for box in crop_corners]
    first, found, modelled_std = _located(network, satellite_features, crops, steps)
    corners = crop_corners.repeat_interleave(samples, dim=0)
    recovered = recover_displacement(corners, found).reshape(views, samples, 4, 2)
    original = found[:samples]
    if steps < iterations and network.is_iterative:
        is_held = stop is not None and stop.is_lookup_held
        going_on = network.refine(first, iterations - steps, original, is_lookup_held=is_held)
        original, modelled_std = going_on.last, going_on.deviations
    return Agreement(recovered, original, stop is not None, modelled_std)


def ensemble_agreement(
    networks: Sequence[DisplacementNetwork],
    satellite: Tensor,
    thermal: Tensor,
    iterations: int = ITERATIONS,
    stop: EarlyStop | None = None,
) -> Agreement:
    """Locate thermal images by several networks (Deep Ensembles); images ``(B, 3, 256, 256)``.

    With early stopping the first network goes on.

    Raises:
        ValueError: fewer than two networks, or early stopping of networks without steps.
    """
    if len(networks) < 2:
        raise ValueError("an ensemble needs at least two networks")
    steps = _steps_together(networks[0], iterations, stop)
    pairings = [n.pair(n.encode_satellite(satellite), thermal) for n in networks]
    found = [
        network.refine(pairing, steps).last
        for network, pairing in zip(networks, pairings, strict=True)
    ]
    original = found[0]
    if steps < iterations and networks[0].is_iterative:
        original = networks[0].refine(pairings[0], iterations - steps, original).last
    return Agreement(torch.stack(found), original, is_stopped=stop is not None)


def _steps_together(network: DisplacementNetwork, iterations: int, stop: EarlyStop | None) -> int:
    """Return how many steps all views take."""
    if stop is None:
        return iterations
    if not network.is_iterative:
        raise ValueError("early stopping is for networks that take several steps")
    if not 1 <= stop.all_views <= iterations:
        raise ValueError(f"early stopping after {stop.all_views} of {iterations} steps")
    return stop.all_views


def _located(
    network: DisplacementNetwork, satellite_features: Tensor, crops: Sequence[Tensor], steps: int
) -> tuple[Any, Tensor, Tensor | None]:
    """Return the whole images' pairing, displacements ``(N * B, 4, 2)`` of all views, deviations.

    The deviations ``(B, 4, 2)`` are what a Direct Modeling head says of the whole images.

    A CPU takes view by view: one view's correlations at a time keep to its caches and to memory.
    """
    samples = len(crops[0])
    if satellite_features.is_cpu and not torch.is_grad_enabled():
        first = network.pair(satellite_features, crops[0])
        seen = network.refine(first, steps)
        found = [seen.last]
        for crop in crops[1:]:
            found.append(network.refine(network.pair(satellite_features, crop), steps).last)
        return first, torch.cat(found), seen.deviations
    pairing = network.pair(satellite_features, torch.cat(list(crops)))
    seen = network.refine(pairing, steps)
    deviations = None if seen.deviations is None else seen.deviations[:samples]
    return pairing.first(samples), seen.last, deviations
