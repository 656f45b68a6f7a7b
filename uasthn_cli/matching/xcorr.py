"""The default estimator: learned cross-correlation over all shifts, brightness beside it."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uasthn_cli.config import DEFAULT_SYMMETRIES
from uasthn_cli.geometry.pixels import cell_mask
from uasthn_cli.matching.appearance import (
    CHANNELS,
    appearance_cells,
    levelled_window,
)
from uasthn_cli.matching.architecture import HALO_PX, STRIDE_PX
from uasthn_cli.matching.device import choose_device
from uasthn_cli.matching.encoders import Encoders, open_encoders
from uasthn_cli.matching.ncc import luma
from uasthn_cli.matching.search import (
    Box,
    best_shift,
    peak_boxes,
    posterior_mass,
    view_masks,
    within_reach,
)
from uasthn_cli.matching.shift_scores import Encoded, FrameScores, ViewPeaks
from uasthn_cli.matching.similarity import TurnedFrame
from uasthn_cli.matching.symmetries import encode_symmetric
from uasthn_cli.seam import Estimate, FitScores
from uasthn_cli.types import (
    BoolArray,
    FloatArray,
    ImageArray,
    MapFeatures,
    MapStatistics,
    MapWindow,
    Ortho,
)
from uasthn_cli.version import code_sha256

_POOLING_OF_SECOND_SCALE = 2
"""The second GSD is half of the first: its cells, pooled, are as far apart as the first's."""

_FIT_REACH_CELLS = 4.0
"""How far from its place, about known, a turned and scaled frame is sought."""

_SHARPNESS_OF_POOLED = 1.3
"""Pooled features correlate better everywhere, also where they should not. Chosen by the mean log
posterior at the true place, over rendered flights of the calibration and the two real ones (see the
model card, weights/xcorr.md)."""


class XcorrEstimator:
    """Searches map features for thermal features; see :class:`uasthn_cli.seam.Estimator`."""

    name = "xcorr"
    halo_px = HALO_PX

    def __init__(
        self,
        encoders: Encoders | Sequence[Encoders],
        *,
        symmetries: int = DEFAULT_SYMMETRIES,
        appearance: bool = True,
        pooling: int = 1,
    ) -> None:
        """Use one trained network, or several whose scores are averaged.

        ``symmetries`` (1 to 8) are shared out among the members, at least one to each. Without
        ``appearance`` brightness and gradient have no say. ``pooling`` cells each way are averaged
        into one before they are compared: what is seen at a finer GSD tells places apart as well on
        a lattice of twice the pitch, at a quarter of the cost.
        """
        self._pooling, self.stride_px = pooling, STRIDE_PX * pooling
        self._sharpness = 1.0 if pooling == 1 else _SHARPNESS_OF_POOLED
        self._members = list(encoders) if isinstance(encoders, Sequence) else [encoders]
        self._symmetries = max(1, symmetries // len(self._members))
        self._appearance = appearance

    @property
    def encoding_id(self) -> str:
        """What shapes features beside the window; see :class:`uasthn_cli.seam.CacheableEncoder`."""
        networks = "+".join(member.identity for member in self._members)
        settings = (self.name, self._symmetries, self._appearance, self._pooling)
        computed_by = (code_sha256(), np.__version__, cv2.__version__)
        return f"{settings} {networks} {computed_by}"

    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        """Return map features ``(C + 2, h / 2, w / 2)`` of all members, zero where not valid.

        The last two are brightness and gradient, if these have a say.
        """
        rgb = np.ascontiguousarray(window.image.transpose(2, 0, 1))
        layers = []
        for member in self._members:
            encode = partial(_satellite, member, window.statistics)
            layers.append(encode_symmetric(encode, rgb, window.valid, self._symmetries))
        features = self._pooled(np.concatenate(layers), window.valid)
        if self._appearance:
            seen = appearance_cells(luma(window.image), window.valid, self.stride_px)
            features = np.concatenate([features, seen])
        return features * cell_mask(window.valid, self.stride_px)

    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        """Return each view at its best shift inside the window.

        Only the first view is scored everywhere; the others where it found something.
        """
        stride_px = self.stride_px
        masks = view_masks(views_px, cell_mask(thermal.valid, stride_px), stride_px)
        search = self._search(features, thermal)
        prior_shift = origin_px / stride_px
        reachable = within_reach(search.shape, prior_shift)
        if evidence is None:
            evidence = np.zeros(search.shape)
        everywhere = (slice(0, search.shape[0]), slice(0, search.shape[1]))
        whole = next(search.scores(masks[:1], [everywhere]))[0] + evidence
        whole = np.where(reachable, whole, -np.inf)
        shifts = [best_shift(whole, otherwise=prior_shift)]
        if len(masks) > 1:
            found = ViewPeaks(len(masks) - 1, prior_shift)
            boxes = list(peak_boxes(whole))
            for box, scores in zip(boxes, search.scores(masks[1:], boxes), strict=True):
                found.update(np.where(reachable[box], scores + evidence[box], -np.inf), box)
            shifts.extend(found.shifts)
        corners = views_px + np.stack(shifts)[:, None] * stride_px
        confidence = posterior_mass(whole, shifts[0], stride_px * thermal.gsd_m)
        return Estimate(corners, confidence, whole)

    def fit_scores(self, features: MapFeatures, thermal: Ortho, origin_px: FloatArray) -> FitScores:
        """Return what scores hypotheses by the learned features near the prior.

        One orientation is enough here: the place is known.
        """
        cells = cell_mask(thermal.valid, self.stride_px).astype(np.float32)
        near = within_reach(_shifts(features, cells), origin_px / self.stride_px, _FIT_REACH_CELLS)
        rows, columns = _box_around(near)
        under = (
            slice(rows.start, rows.stop + cells.shape[0] - 1),
            slice(columns.start, columns.stop + cells.shape[1] - 1),
        )
        members = [
            Encoded(
                window[: member.channels, *under],
                self._pooled(member.thermal(thermal.image, thermal.valid), thermal.valid),
                member.temperature,
            )
            for member, window in self._windows(features)
        ]
        return TurnedFrame(members, cells, near[rows, columns])

    def _search(self, features: MapFeatures, thermal: Ortho) -> FrameScores:
        """Return a frame and a window, encoded."""
        frames = []
        for member, window in self._windows(features):
            encoded = encode_symmetric(
                member.thermal, thermal.image, thermal.valid, self._symmetries
            )
            pooled = self._pooled(encoded, thermal.valid)
            frames.append(Encoded(window, pooled, member.temperature * self._sharpness))
        levelled = cells = None
        if self._appearance:
            own = features.values[-len(CHANNELS) :].astype(np.float32)
            levelled = levelled_window(own, features.valid)
            cells = appearance_cells(thermal.image, thermal.valid, self.stride_px)
        return FrameScores(frames, features.valid, levelled, cells)

    def _pooled(self, features: ImageArray, valid: BoolArray) -> ImageArray:
        """Return features averaged over ``pooling`` cells each way, those beyond ``valid`` as 0."""
        if self._pooling == 1:
            return features
        inside = features * cell_mask(valid, STRIDE_PX)
        size = (inside.shape[2] // self._pooling, inside.shape[1] // self._pooling)
        planes = [cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in inside]
        return np.stack(planes)

    def _windows(self, features: MapFeatures) -> Iterator[tuple[Encoders, ImageArray]]:
        """Yield each member with its map features ``(channels, h, w)``."""
        first = 0
        for member in self._members:
            last = first + self._symmetries * member.channels
            yield member, features.values[first:last].astype(np.float32, copy=False)
            first = last


def open_xcorr(
    paths: Sequence[Path], device: str, symmetries: int, *, second_scale: bool = False
) -> XcorrEstimator:
    """Return the estimator with the networks of files, on ``auto|cpu|cuda``.

    The scores of several are averaged. What looks at the second scale sees learned features alone,
    on the lattice of the first.

    Raises:
        WeightsError: the weights cannot be used.
    """
    chosen = choose_device(device)
    return XcorrEstimator(
        [open_encoders(path, chosen) for path in paths],
        symmetries=symmetries,
        appearance=not second_scale,
        pooling=_POOLING_OF_SECOND_SCALE if second_scale else 1,
    )


def _satellite(
    member: Encoders, statistics: MapStatistics, rgb: ImageArray, valid: BoolArray
) -> ImageArray:
    return member.satellite(rgb, valid, statistics)


def _shifts(features: MapFeatures, cells: ImageArray) -> tuple[int, int]:
    """Return how many rows and columns of shifts keep a frame's cells inside the window."""
    rows, columns = features.valid.shape
    return rows - cells.shape[0] + 1, columns - cells.shape[1] + 1


def _box_around(near: BoolArray) -> Box:
    """Return the rows and columns that hold all true entries, of which there are some."""
    rows, columns = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
