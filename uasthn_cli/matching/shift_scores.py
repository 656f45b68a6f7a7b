"""Log-likelihoods of the shifts of one frame in one window, of any of its views."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from uasthn_cli.matching.appearance import appearance_kernels, appearance_scores
from uasthn_cli.matching.correlate import Kernels, correlate, template_kernels
from uasthn_cli.matching.search import MIN_OVERLAP, Box, best_shift
from uasthn_cli.types import BoolArray, FloatArray, ImageArray


@dataclass(frozen=True, slots=True)
class Encoded:
    """One member's features of the window ``(C, H, W)`` and of the frame ``(C, h, w)``."""

    window: ImageArray
    frame: ImageArray
    temperature: float


class FrameScores:
    """Log-likelihoods of shifts of one frame in one window."""

    def __init__(
        self,
        members: Sequence[Encoded],
        valid: BoolArray,
        levelled: ImageArray | None,
        cells: ImageArray | None,
    ) -> None:
        """Keep what was encoded; ``levelled`` and ``cells`` are brightness and gradient, if any."""
        self._members, self._levelled, self._cells = members, levelled, cells
        self._valid = None if valid.all() else valid.astype(np.float32)[None]
        rows, columns = members[0].frame.shape[1:]
        self._last = (rows - 1, columns - 1)
        self.shape = (valid.shape[0] - self._last[0], valid.shape[1] - self._last[1])

    def scores(self, masks: ImageArray, boxes: Iterable[Box]) -> Iterator[FloatArray]:
        """Yield the scores ``(N, rows, columns)`` of views at the shifts in each box.

        ``masks`` ``(N, h, w)``; -inf where a view lies too far beyond valid map.
        """
        learned = [template_kernels(one.frame, masks) for one in self._members]
        seen = None if self._cells is None else appearance_kernels(self._cells, masks)
        cover = None if self._valid is None else Kernels(masks[:, None])
        cells = np.maximum(masks.sum(axis=(1, 2)), 1.0)[:, None, None]
        for rows, columns in boxes:
            under = (
                slice(None),
                slice(rows.start, rows.stop + self._last[0]),
                slice(columns.start, columns.stop + self._last[1]),
            )
            scores = self._learned_scores(under, learned)
            if seen is not None and self._levelled is not None:
                scores += appearance_scores(self._levelled[under], seen)
            if cover is not None and self._valid is not None:
                covered = cover.sums(self._valid[under], [(slice(1), slice(1))])[:, 0]
                scores = np.where(covered / cells >= MIN_OVERLAP, scores, -np.inf)
            yield scores

    def _learned_scores(
        self, under: tuple[slice, slice, slice], kernels: Sequence[Kernels]
    ) -> FloatArray:
        """Return the members' mean score of views at all shifts inside a part of the window."""
        scores = [
            correlate(one.window[under], own) * np.float32(one.temperature)
            for one, own in zip(self._members, kernels, strict=True)
        ]
        return np.asarray(np.mean(scores, axis=0, dtype=np.float64))


class ViewPeaks:
    """The best shifts of views among boxes that are scored one after another."""

    def __init__(self, views: int, otherwise: FloatArray) -> None:
        """Start with every view at ``otherwise`` ``(2,)``."""
        self.shifts = [otherwise] * views
        self._best = np.full(views, -np.inf)

    def update(self, scores: FloatArray, box: Box) -> None:
        """Let each view move to its best shift in a box, ``(views, rows, columns)``, if better."""
        for view, own in enumerate(scores):
            best = float(own.max())
            if best > self._best[view]:
                corner = np.array([box[1].start, box[0].start], np.float64)
                self._best[view], self.shifts[view] = best, best_shift(own) + corner
