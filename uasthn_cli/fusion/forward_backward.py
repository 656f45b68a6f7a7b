"""Forward-backward over a flight: each frame's posterior given all frames (Rabiner 1989, eq. 27).

The hidden state is the error of the log's position. It wanders between frames (a random walk whose
variance grows with time), and each frame's likelihood sees it, or now and then something else: with
the outlier share, a frame says nothing.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from uasthn_cli.fusion.spool import Spool
from uasthn_cli.types import LOG_OF_LEVEL, FloatArray, ImageArray, OffsetLikelihood

OUTLIER_SHARE = 0.02
"""Frames whose likelihood may be all wrong (design: 2 %)."""

_LEAST_BLUR_CELLS = 0.3
_TINY = 1e-12
_WEIGHT_OF_LEVEL = np.exp(LOG_OF_LEVEL.astype(np.float64))


@dataclass(frozen=True, slots=True)
class Smoothed:
    """Posteriors, each ``(n, n)`` float32, given the whole flight, and the flight's log evidence.

    The posteriors lie on disk: a flight of any length takes the same memory.
    """

    posteriors: Spool[np.float32]
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

    Raises:
        OutputError: there is no room for temporary data.
    """
    chain = _Chain(likelihoods, times_s)
    kept, log_evidence = chain.filtered(diffusion_m_per_sqrt_s)
    backward = np.ones(chain.shape, np.float32)
    for index in range(len(kept) - 1, -1, -1):
        joint = kept[index] * backward
        kept.replace(index, joint / max(float(joint.sum()), _TINY))
        if index:
            seen = backward * chain.evidence(index)
            backward = chain.wander(seen, index, diffusion_m_per_sqrt_s, backwards=True)
            backward /= max(float(backward.mean()), _TINY)
    return Smoothed(kept, log_evidence)


def log_evidence(
    likelihoods: Sequence[OffsetLikelihood | None],
    times_s: FloatArray,
    diffusions_m_per_sqrt_s: Sequence[float],
) -> FloatArray:
    """Return how well frames predict one another by each diffusion ``(K,)``.

    It is the log of what their likelihoods agree on. Each of them is read once.
    """
    chain = _Chain(likelihoods, times_s)
    states = [chain.start() for _ in diffusions_m_per_sqrt_s]
    totals = np.zeros(len(states))
    for index in range(len(times_s)):
        evidence = chain.evidence(index)
        for k, diffusion in enumerate(diffusions_m_per_sqrt_s):
            states[k], gain = chain.step(states[k], evidence, index, diffusion)
            totals[k] += gain
    return totals


class _Chain:
    """The flight as a chain of grids."""

    def __init__(self, likelihoods: Sequence[OffsetLikelihood | None], times_s: FloatArray) -> None:
        known = next(entry for entry in likelihoods if entry is not None)
        self.shape, self._cell_m = known.levels.shape, known.cell_m
        self._likelihoods, self._times_s = likelihoods, times_s
        self._centres_m = _filled_centres_m(likelihoods, known.centre_m)

    def start(self) -> ImageArray:
        """Return what is known ``(n, n)`` before any frame."""
        return np.full(self.shape, 1.0 / np.prod(self.shape), np.float32)

    def filtered(self, diffusion_m_per_sqrt_s: float) -> tuple[Spool[np.float32], float]:
        """Return each frame's posterior given the frames up to it, and the log evidence."""
        kept: Spool[np.float32] = Spool(self.shape, np.float32)
        state, total = self.start(), 0.0
        for index in range(len(self._likelihoods)):
            state, gain = self.step(state, self.evidence(index), index, diffusion_m_per_sqrt_s)
            total += gain
            kept.append(state)
        return kept, total

    def step(
        self, state: ImageArray, evidence: ImageArray, index: int, diffusion_m_per_sqrt_s: float
    ) -> tuple[ImageArray, float]:
        """Return the state after frame ``index`` from the one before, and the log of its gain."""
        if index:
            state = self.wander(state, index, diffusion_m_per_sqrt_s, backwards=False)
            state /= max(float(state.sum()), _TINY)
        state = state * evidence
        mass = max(float(state.sum()), _TINY)
        state /= mass
        return state, math.log(mass)

    def evidence(self, index: int) -> ImageArray:
        """Return the likelihood ``(n, n)`` of frame ``index``, outliers allowed for; mean 1."""
        entry = self._likelihoods[index]
        if entry is None:
            return np.ones(self.shape, np.float32)
        counts = np.bincount(entry.levels.ravel(), minlength=256)
        scale = (1.0 - OUTLIER_SHARE) * entry.levels.size / float(counts @ _WEIGHT_OF_LEVEL)
        table = (scale * _WEIGHT_OF_LEVEL + OUTLIER_SHARE).astype(np.float32)
        return np.asarray(cv2.LUT(entry.levels, table), dtype=np.float32).reshape(self.shape)

    def wander(
        self, state: ImageArray, index: int, diffusion_m_per_sqrt_s: float, *, backwards: bool
    ) -> ImageArray:
        """Carry a state from frame ``index - 1`` to ``index``, or back."""
        elapsed_s = abs(float(self._times_s[index] - self._times_s[index - 1]))
        moved_m = self._centres_m[index] - self._centres_m[index - 1]
        if backwards:
            moved_m = -moved_m
        if moved_m.any():
            state = self._moved(state, moved_m)
        sigma_cells = diffusion_m_per_sqrt_s * elapsed_s**0.5 / self._cell_m
        # a blur wider than this leaves nothing of a grid, and hours between flights cost seconds
        sigma_cells = min(max(_LEAST_BLUR_CELLS, sigma_cells), 2.0 * max(self.shape))
        blurred = cv2.GaussianBlur(state, (0, 0), sigma_cells, borderType=cv2.BORDER_REFLECT)
        return np.asarray(blurred + _TINY, dtype=np.float32)

    def _moved(self, state: ImageArray, moved_m: FloatArray) -> ImageArray:
        """Return a state on a grid whose centre lies ``moved_m`` (east, north) farther."""
        right, down = moved_m[0] / self._cell_m, -moved_m[1] / self._cell_m
        shift = np.array([[1.0, 0.0, right], [0.0, 1.0, down]])
        moved = cv2.warpAffine(
            state,
            shift,
            self.shape[::-1],
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=0.0,
        )
        return np.asarray(moved, dtype=np.float32)


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
