"""An estimator whose answers a test decides, and pairs whose truth it knows."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.datasets.samples import MatchSample
from uasthn_cli.datasets.windows import square_corners_px
from uasthn_cli.evaluation.predictions import Prediction, Predictions, Settings, gathered
from uasthn_cli.geometry.corners import DegenerateHomographyError
from uasthn_cli.seam import Estimate
from uasthn_cli.types import FloatArray, MapFeatures, MapWindow, Ortho

SETTINGS = Settings(
    dataset="somewhere",
    estimator="known",
    weights=(),
    views=5,
    sampling="random",
    offset_fraction=1 / 16,
    seed=0,
    max_offset_m=128.0,
    window_m=None,
    width_px=None,
    device="cpu",
)


@dataclass(frozen=True, slots=True)
class KnownPairs:
    """Pairs whose thermal image lies ``offsets_px`` from the middle of a satellite image."""

    offsets_px: tuple[tuple[float, float], ...]
    satellite_px: int = 160
    thermal_px: int = 48
    gsd_m: float = 2.0

    def __len__(self) -> int:
        return len(self.offsets_px)

    def __getitem__(self, index: int) -> MatchSample:
        centre_px = (self.satellite_px - 1) / 2 + np.array(self.offsets_px[index])
        rng = np.random.default_rng(index)
        return MatchSample(
            f"pair {index}",
            rng.integers(1, 255, (self.satellite_px, self.satellite_px, 3)).astype(np.uint8),
            rng.integers(0, 255, (self.thermal_px, self.thermal_px)).astype(np.uint8),
            square_corners_px(self.thermal_px, centre_px),
            self.gsd_m,
        )


class ShiftEstimator:
    """Answers every view by the prior moved by ``shift_px`` window pixels, and counts its calls."""

    name = "known"
    stride_px = 2
    halo_px = 0

    def __init__(
        self, shift_px: tuple[float, float] = (0.0, 0.0), spoil: Callable[..., None] | None = None
    ) -> None:
        self.shift_px, self._spoil = np.array(shift_px), spoil
        self.views: list[int] = []

    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        return window.image[::2, ::2].transpose(2, 0, 1)

    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        self.views.append(len(views_px))
        found_px = views_px + origin_px + self.shift_px
        if self._spoil is not None:
            self._spoil(found_px)
        return Estimate(found_px, 0.5)


def refuse(_: FloatArray) -> None:
    """Spoil an answer altogether."""
    raise DegenerateHomographyError("the middle of the corners is mapped to infinity")


def made_up_predictions(
    errors_m: FloatArray, std_m: FloatArray, *, members: int = 1, views: int = 5, **changes: Any
) -> Predictions:
    """Return samples off by ``errors_m`` ``(n,)`` east, whose views deviate by ``std_m`` ``(n,)``.

    The members deviate by twice as much, the mean of views and members being view 0.
    """
    gsd_m = 2.0
    samples = []
    true_px = square_corners_px(48, np.array([90.0, 70.0]))
    for index, (error_m, deviation_m) in enumerate(zip(errors_m, std_m, strict=True)):
        answers = np.full((members, views, 4, 2), np.nan)
        whole = true_px + np.array([error_m / gsd_m, 0.0])
        answers[0] = whole + _spread(views, deviation_m / gsd_m)
        answers[:, 0] = whole + _spread(members, 2.0 * deviation_m / gsd_m)
        answers[0, 0] = whole
        samples.append(
            Prediction(
                name=f"sample {index}",
                gsd_m=gsd_m,
                satellite_px=160,
                true_px=true_px,
                prior_px=square_corners_px(48, np.full(2, 79.5)),
                answers_px=answers,
                modelled_std_px=np.full((4, 2), np.nan),
                confidence=0.5,
                seconds=np.array([0.1, 0.2, 0.3]),
            )
        )
    return gathered(replace(SETTINGS, **changes), samples)


def _spread(count: int, deviation_px: float) -> FloatArray:
    """Return ``(count, 1, 1)`` numbers, the first and the mean 0, of this unbiased deviation."""
    steps = np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1)
    steps = np.concatenate([[0.0], np.delete(steps, count // 2)])
    scale = steps.std(ddof=1) if count > 1 else 1.0
    return np.asarray((steps / scale * deviation_px)[:, None, None])
