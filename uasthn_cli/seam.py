"""The seam between estimators and everything else: what is asked of them, and what they answer.

CropTTA, ensembles and merges are written once against it; conventions are those of
:mod:`uasthn_cli.types`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.types import FloatArray, MapFeatures, MapWindow, Ortho


@dataclass(frozen=True, slots=True)
class Estimate:
    """Where an estimator saw N views of one thermal image in one map window.

    ``corners_px`` ``(N, 4, 2)``: corners of each view in window pixels. ``scores``
    ``(rows, columns)`` is the first view's log-likelihood of every shift (-inf where excluded):
    entry ``(j, i)`` puts ortho pixel (0, 0) on window pixel ``(i, j) * stride_px``; None for an
    estimator that does not score shifts. ``confidence`` in 0..1 is the posterior mass near the
    first view's answer (1 without scores). ``modelled_std_px`` ``(4, 2)`` is what a network itself
    says of the first view's corners (the paper's Direct Modeling), None where it says nothing.
    """

    corners_px: FloatArray
    confidence: float
    scores: FloatArray | None = None
    modelled_std_px: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Similarity:
    """How the ground seen by a frame differs from what the prior implied, apart from its place.

    The frame's footprint appears turned by ``yaw_rad`` (clockwise on the north-up map) and enlarged
    by ``scale`` about the ortho's middle.
    """

    yaw_rad: float = 0.0
    scale: float = 1.0


class Estimator(Protocol):
    """The one seam that every matcher implements (design: CropTTA, ensembles and merges sit on it).

    ``encode_map`` is computed per map tile and cached for the flight; ``estimate`` per frame.
    """

    @property
    def name(self) -> str:
        """Name as given to ``--estimator``."""

    @property
    def stride_px(self) -> int:
        """Map pixels per feature cell."""

    @property
    def halo_px(self) -> int:
        """Context in pixels that ``encode_map`` needs around a tile."""

    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        """Return map features ``(channels, h / stride, w / stride)`` of a window."""

    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        """Locate views ``(N, 4, 2)`` (corners in ortho pixels) of ``thermal`` in the window.

        ``origin_px`` ``(2,)`` is the window pixel where the prior puts ortho pixel (0, 0).
        ``evidence`` ``(rows, columns)`` is what else is known of every shift, a log-likelihood on
        the lattice of :attr:`Estimate.scores`; it counts for every view. An estimator that does
        not score shifts leaves it aside.
        """


@runtime_checkable
class CacheableEncoder(Protocol):
    """An estimator whose map features may be kept on disk and used again by other runs."""

    @property
    def encoding_id(self) -> str:
        """Who encodes, now: equal strings mean equal features of equal windows.

        Windows are equal when their pixels, masks, resolution and statistics are, wherever they
        lie. Whatever else shapes features, be it weights, settings, code or hardware, belongs here.
        """


@runtime_checkable
class SelfAssessor(Protocol):
    """An estimator whose network may have been trained to say how far off it is."""

    @property
    def models_std(self) -> bool:
        """Whether its estimates have :attr:`Estimate.modelled_std_px`."""


FitScores = Callable[[Sequence[Similarity]], FloatArray]
"""Returns the best log-likelihood ``(n,)`` of a frame under each of n hypotheses."""


@runtime_checkable
class Aligner(Protocol):
    """An estimator that can also tell how well a frame fits when it is turned and scaled."""

    def fit_scores(self, features: MapFeatures, thermal: Ortho, origin_px: FloatArray) -> FitScores:
        """Return what scores hypotheses about a frame.

        ``features`` are of a window little larger than the frame; ``origin_px`` as in
        :meth:`Estimator.estimate`.
        """
