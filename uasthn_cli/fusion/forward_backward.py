"""Forward-backward over a flight: each frame's posterior given all frames (Rabiner 1989, eq. 27).

The hidden state is the error of the log's position. It wanders between frames (a random walk whose
variance grows with time), and each frame's likelihood sees it, or now and then something else: with
the outlier share, a frame says nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from uasthn_cli.types import FloatArray, OffsetLikelihood

OUTLIER_SHARE = 0.02
"""Frames whose likelihood may be all wrong (design: 2 %)."""

_LEAST_BLUR_CELLS = 0.3
_TINY = 1e-12


@dataclass(frozen=True, slots=True)
class Smoothed:
    """Posteriors ``(T, n, n)`` float32 given the whole flight, and the flight's log evidence."""

    posteriors: np.ndarray
    log_evidence: float


def smooth(
    likelihoods: Sequence[OffsetLikelihood | None],
    times_s: FloatArray,
    diffusion_m_per_sqrt_s: float,
) -> Smoothed:
    """Return every frame's posterior over its offset, given all frames.

    ``likelihoods`` (None: the frame says nothing) share size and cell; each may have a centre of
    its own, those without one are taken to lie where the one before does. ``times_s`` ``(T,)``
    rises.
    """
    chain = _Chain(likelihoods, times_s, diffusion_m_per_sqrt_s)
    forward, log_evidence = chain.forward()
    backward = np.ones_like(forward[0])
    for index in range(len(forward) - 1, -1, -1):
        evidence = chain.evidence(index)
        joint = forward[index] * backward
        forward[index] = joint / max(float(joint.sum()), _TINY)
        if index:
            backward = chain.wander(backward * evidence, index, backwards=True)
            backward /= max(float(backward.mean()), _TINY)
    return Smoothed(forward, log_evidence)


def log_evidence(
    likelihoods: Sequence[OffsetLikelihood | None],
    times_s: FloatArray,
    diffusion_m_per_sqrt_s: float,
) -> float:
    """Return how well frames predict one another: the log of what their likelihoods agree on."""
    return _Chain(likelihoods, times_s, diffusion_m_per_sqrt_s).forward(keep=False)[1]


class _Chain:
    """The flight as a chain of grids."""

    def __init__(
        self,
        likelihoods: Sequence[OffsetLikelihood | None],
        times_s: FloatArray,
        diffusion_m_per_sqrt_s: float,
    ) -> None:
        known = next(entry for entry in likelihoods if entry is not None)
        self._shape, self._cell_m = known.log_likelihood.shape, known.cell_m
        self._likelihoods, self._times_s = likelihoods, times_s
        self._diffusion_m_per_sqrt_s = diffusion_m_per_sqrt_s
        self._centres_m = _filled_centres_m(likelihoods, known.centre_m)

    def forward(self, keep: bool = True) -> tuple[np.ndarray, float]:
        """Return filtered posteriors ``(T, n, n)`` (only the last unless kept), log evidence."""
        count = len(self._likelihoods)
        kept = np.empty((count if keep else 1, *self._shape), np.float32)
        current = np.full(self._shape, 1.0 / np.prod(self._shape), np.float32)
        total = 0.0
        for index in range(count):
            if index:
                current = self.wander(current, index, backwards=False)
                current /= max(float(current.sum()), _TINY)
            current = current * self.evidence(index)
            mass = max(float(current.sum()), _TINY)
            current /= mass
            total += float(np.log(mass))
            kept[index if keep else 0] = current
        return kept, total

    def evidence(self, index: int) -> np.ndarray:
        """Return the likelihood ``(n, n)`` of frame ``index``, outliers allowed for; mean 1."""
        entry = self._likelihoods[index]
        if entry is None:
            return np.ones(self._shape, np.float32)
        weights = np.exp(entry.log_likelihood.astype(np.float32))
        level = (1.0 - OUTLIER_SHARE) * weights.size / float(weights.sum())
        return np.asarray(level * weights + OUTLIER_SHARE, dtype=np.float32)

    def wander(self, state: np.ndarray, index: int, *, backwards: bool) -> np.ndarray:
        """Carry a state from frame ``index - 1`` to ``index``, or back."""
        elapsed_s = abs(float(self._times_s[index] - self._times_s[index - 1]))
        moved_m = self._centres_m[index] - self._centres_m[index - 1]
        if backwards:
            moved_m = -moved_m
        if moved_m.any():
            state = self._moved(state, moved_m)
        sigma_cells = self._diffusion_m_per_sqrt_s * elapsed_s**0.5 / self._cell_m
        # a blur wider than this leaves nothing of a grid, and hours between flights cost seconds
        sigma_cells = min(max(_LEAST_BLUR_CELLS, sigma_cells), 2.0 * max(self._shape))
        blurred = cv2.GaussianBlur(
            state.astype(np.float32), (0, 0), sigma_cells, borderType=cv2.BORDER_REFLECT
        )
        return np.asarray(blurred + _TINY, dtype=np.float32)

    def _moved(self, state: np.ndarray, moved_m: FloatArray) -> np.ndarray:
        """Return a state on a grid whose centre lies ``moved_m`` (east, north) farther."""
        right, down = moved_m[0] / self._cell_m, -moved_m[1] / self._cell_m
        shift = np.array([[1.0, 0.0, right], [0.0, 1.0, down]])
        return cv2.warpAffine(
            state.astype(np.float32),
            shift,
            self._shape[::-1],
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=0.0,
        )


def _filled_centres_m(
    likelihoods: Sequence[OffsetLikelihood | None], first_m: FloatArray
) -> FloatArray:
    """Return centres ``(T, 2)``; a frame without a likelihood lies where the one before does."""
    centres = []
    centre_m = first_m
    for entry in likelihoods:
        centre_m = centre_m if entry is None else entry.centre_m
        centres.append(centre_m)
    return np.array(centres, dtype=np.float64)
