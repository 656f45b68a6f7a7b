"""The paper's networks as estimators ``dhn``, ``ihn`` and ``sthn`` behind the common seam."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uasthn_cli.config import RESIZED_WIDTH_PX
from uasthn_cli.errors import WeightsError
from uasthn_cli.geometry.corners import (
    DegenerateHomographyError,
    homography_from_corners,
    image_corners_px,
    transform_points,
)
from uasthn_cli.matching.device import choose_device
from uasthn_cli.matching.displacement.agreement import EarlyStop, crop_agreement
from uasthn_cli.matching.displacement.checkpoints import load_displacement
from uasthn_cli.matching.displacement.homography import corners_at_width, resize_to_network
from uasthn_cli.matching.displacement.ihn import IterativeHomographyNetwork
from uasthn_cli.matching.displacement.model import DisplacementModel
from uasthn_cli.matching.displacement.sthn import look_again
from uasthn_cli.seam import Estimate
from uasthn_cli.types import FloatArray, ImageArray, MapFeatures, MapWindow, Ortho

_DERIVATIVE_STEP_PX = 1e-3


@dataclass(frozen=True, slots=True)
class Square:
    """A square of whole pixels of an image, which may reach beyond it; ``first_px`` is (x, y)."""

    first_px: tuple[int, int]
    width_px: int

    @classmethod
    def around(cls, middle_px: FloatArray, width_px: float) -> "Square":
        """Return the square of at least ``width_px`` pixels about a place ``(2,)``."""
        width = max(2, math.ceil(width_px))
        x, y = (round(float(value) - 0.5 * (width - 1)) for value in middle_px)
        return cls((x, y), width)

    @property
    def corners_px(self) -> FloatArray:
        """Corners ``(4, 2)`` in pixels of the image."""
        corners: FloatArray = image_corners_px(self.width_px, self.width_px) + self.first_px
        return corners

    def cut(self, image: ImageArray, fill: float = 0.0) -> ImageArray:
        """Return the square ``(C, w, w)`` of an image ``(C, h, w)``, ``fill`` beyond it."""
        square = np.full((len(image), self.width_px, self.width_px), fill, np.float32)
        (x, y), (rows, columns) = self.first_px, image.shape[1:]
        top, bottom = max(0, y), min(rows, y + self.width_px)
        left, right = max(0, x), min(columns, x + self.width_px)
        if top < bottom and left < right:
            square[:, top - y : bottom - y, left - x : right - x] = image[:, top:bottom, left:right]
        return square


class DisplacementEstimator:
    """Regresses the corners of the ortho's square in a square of the window.

    The window's square is as much wider than the ortho's as in training, since a network knows no
    other scale, and centred where the prior puts the frame. What is beyond the window is black,
    what the ortho does not show has its mean. Confidence is 1: this network says nothing of it.
    """

    stride_px = 1
    halo_px = 0

    def __init__(
        self, model: DisplacementModel, *, device: str = "cpu", stop: EarlyStop | None = None
    ) -> None:
        """Use a model on a device; with ``stop`` crops are dropped before the last steps."""
        self.name, self._settings, self._stop = model.name, model.settings, stop
        self.models_std = bool(getattr(model.network.architecture, "has_uncertainty_head", False))
        self._device = torch.device(device)
        self._network = model.network.eval().to(self._device)
        self._second = None if model.second is None else model.second.eval().to(self._device)

    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        """Return colour ``(3, h, w)`` in 0..1: normalisation needs the whole square, not tiles."""
        return np.moveaxis(window.image, -1, 0)

    @torch.inference_mode()
    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        """Return each view's corners by its own homography from ortho to window.

        A view is seen as the upright square around it. One without a homography answers with the
        prior, so that views disagree. STHN's second stage looks at the whole frame alone; what it
        corrects there is corrected in every view (paper: "We apply UE only for the first stage").

        Raises:
            DegenerateHomographyError: the first view has no homography.
        """
        middles_px, widths_px = _extents(views_px)
        ortho = Square.around(middles_px[0], widths_px[0])
        window = Square.around(
            middles_px[0] + origin_px, self._settings.width_ratio * ortho.width_px
        )
        satellite = self._tensor(window.cut(features.values.astype(np.float32)))
        shown = thermal.image[thermal.valid]
        grey = np.where(thermal.valid, thermal.image, shown.mean() if shown.size else 0.0)
        image = ortho.cut(grey.astype(np.float32)[None], float(grey.mean()))
        small = resize_to_network(self._tensor(image).expand(-1, 3, -1, -1)).clamp(0.0, 1.0)
        boxes = _boxes(ortho, middles_px, widths_px)
        found, modelled_std = self._located(satellite, small, boxes)
        corners = corners_at_width(found, window.width_px).double().cpu().numpy()
        placed = _placed(ortho, corners + window.first_px, views_px, views_px + origin_px)
        if self._second is not None:
            better = self._second_look(self._second, satellite, small, found[:1])
            placed = transform_points(
                homography_from_corners(corners[0] + window.first_px, better + window.first_px),
                placed,
            )
        if modelled_std is None:
            return Estimate(placed, 1.0)
        std_px = modelled_std.double().cpu().numpy() * (window.width_px / RESIZED_WIDTH_PX)
        carried_px = _carried_std_px(ortho.corners_px, corners[0], std_px, views_px[0])
        return Estimate(placed, 1.0, modelled_std_px=carried_px)

    def _tensor(self, image: ImageArray) -> Tensor:
        """Return ``(1, C, h, w)`` on the device."""
        return torch.from_numpy(image)[None].to(self._device)

    def _second_look(
        self,
        network: IterativeHomographyNetwork,
        satellite: Tensor,
        thermal: Tensor,
        displacement: Tensor,
    ) -> FloatArray:
        """Return corners ``(4, 2)`` in the window's square as the second stage has them."""
        settings = self._settings
        seen = look_again(
            network,
            satellite,
            thermal,
            displacement,
            settings.second_iterations,
            settings.box_padding,
        )
        corners = corners_at_width(seen.displacement[0], satellite.shape[-1])
        better: FloatArray = corners.double().cpu().numpy()
        return better

    def _located(
        self, satellite: Tensor, thermal: Tensor, boxes: FloatArray
    ) -> tuple[Tensor, Tensor | None]:
        """Return displacements ``(N, 4, 2)`` of the ortho's square as each view has it.

        Beside them, the deviations ``(4, 2)`` that a Direct Modeling head gives the first one's.

        With early stopping the first view's is what it was when all views were stopped, plus what
        came after: the spread then is that of the views when they were stopped.
        """
        network, settings = self._network, self._settings
        encoded = network.encode_satellite(resize_to_network(satellite).clamp(0.0, 1.0))
        if len(boxes) == 1:
            pairing: Any = network.pair(encoded, thermal)
            seen = network.refine(pairing, settings.iterations)
            return seen.last, None if seen.deviations is None else seen.deviations[0]
        corners = torch.from_numpy(boxes).to(thermal)
        agreed = crop_agreement(network, encoded, thermal, corners, settings.iterations, self._stop)
        found = agreed.samples[:, 0]
        std = None if agreed.modelled_std is None else agreed.modelled_std[0]
        return found + (agreed.original[0] - found[0]), std


def open_displacement(
    name: str, weights_path: Path, device: str, ue_iterations: int | None = None
) -> DisplacementEstimator:
    """Return ``dhn``, ``ihn`` or ``sthn`` with weights of a user's own, on ``auto|cpu|cuda``.

    ``ue_iterations`` is how many steps all views take before the whole frame goes on alone. The
    weights of an STHN also make an ``ihn``: its first stage.

    Raises:
        WeightsError: unreadable weights, those of another network, or early stopping without steps.
    """
    model = load_displacement(weights_path)
    if name == "ihn" and model.name == "sthn":
        model = DisplacementModel(model.network, None, model.settings, model.notes)
    if model.name != name:
        raise WeightsError(f"{weights_path}: these weights are for {model.name}, not for {name}")
    if ue_iterations is not None and not 1 <= ue_iterations <= _steps(model):
        raise WeightsError(
            f"early stopping after {ue_iterations} steps: {name} with these weights takes"
            f" {_steps(model)}"
        )
    stop = None if ue_iterations is None else EarlyStop(ue_iterations)
    return DisplacementEstimator(model, device=choose_device(device), stop=stop)


def _steps(model: DisplacementModel) -> int:
    return model.settings.iterations if model.network.is_iterative else 0


def _extents(views_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return middles ``(N, 2)`` and widths ``(N,)`` in pixels of the squares around views."""
    first, last = views_px.min(axis=1), views_px.max(axis=1)
    return 0.5 * (first + last), (last - first).max(axis=1) + 1.0


def _boxes(ortho: Square, middles_px: FloatArray, widths_px: FloatArray) -> FloatArray:
    """Return the views' squares ``(N, 4, 2)`` in the resized ortho; the first is all of it."""
    unit = 2.0 * image_corners_px(2, 2) - 1.0
    corners_px = middles_px[:, None] + unit * (0.5 * (widths_px - 1.0))[:, None, None]
    scale = (RESIZED_WIDTH_PX - 1.0) / (ortho.width_px - 1.0)
    boxes: FloatArray = (corners_px - np.asarray(ortho.first_px)) * scale
    boxes[0] = image_corners_px(RESIZED_WIDTH_PX, RESIZED_WIDTH_PX)
    return boxes


def _placed(
    ortho: Square, corners_px: FloatArray, views_px: FloatArray, otherwise_px: FloatArray
) -> FloatArray:
    """Return views ``(N, 4, 2)`` carried over by what each makes of the ortho's square."""
    placed = otherwise_px.copy()
    for index, (corners, view) in enumerate(zip(corners_px, views_px, strict=True)):
        try:
            placed[index] = transform_points(
                homography_from_corners(ortho.corners_px, corners), view
            )
        except DegenerateHomographyError:
            if index == 0:
                raise
    return placed


def _carried_std_px(
    square_px: FloatArray, corners_px: FloatArray, std_px: FloatArray, view_px: FloatArray
) -> FloatArray:
    """Return the deviations ``(4, 2)`` of a view's corners inside a square whose corners deviate.

    The network speaks of the square's corners, which are not those of a frame that is turned or not
    square. To first order, and as if the eight numbers ``std_px`` ``(4, 2)`` were independent: each
    moves the homography from ``square_px`` to ``corners_px``, and that moves the view.

    Raises:
        DegenerateHomographyError: the corners do not define a homography.
    """
    steps = np.concatenate([np.zeros((1, 8)), _DERIVATIVE_STEP_PX * np.eye(8)])
    moved_px = corners_px + steps.reshape(-1, 4, 2)
    H = homography_from_corners(np.broadcast_to(square_px, moved_px.shape), moved_px)
    placed_px = transform_points(H, np.broadcast_to(view_px, moved_px.shape))
    slopes = (placed_px[1:] - placed_px[0]) / _DERIVATIVE_STEP_PX
    carried: FloatArray = np.sqrt(((slopes * std_px.reshape(8, 1, 1)) ** 2).sum(axis=0))
    return carried
