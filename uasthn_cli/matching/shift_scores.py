"""Log-likelihoods of the shifts of one frame in one window, of any of its views."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from uasthn_cli.matching.appearance import appearance_scores
from uasthn_cli.matching.correlate import correlate, normalise_template, sliding_sums
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
        templates = [normalise_template(one.frame, masks) for one in self._members]
        for rows, columns in boxes:
            under = (
                slice(None),
                slice(rows.start, rows.stop + self._last[0]),
                slice(columns.start, columns.stop + self._last[1]),
            )
            yield self._scores_under(under, templates, masks)

    def _scores_under(
        self, under: tuple[slice, slice, slice], templates: Sequence[ImageArray], masks: ImageArray
    ) -> FloatArray:
        """Return the scores of views at all shifts inside a part of the window."""
        learned = [
            correlate(one.window[under], template, masks) * np.float32(one.temperature)
            for one, template in zip(self._members, templates, strict=True)
        ]
        scores = np.mean(learned, axis=0, dtype=np.float64)
        if self._levelled is not None and self._cells is not None:
            scores += appearance_scores(self._levelled[under], self._cells, masks)
        if self._valid is None:
            return np.asarray(scores)
        covered = sliding_sums(self._valid[under], masks[:, None], [(slice(1), slice(1))])[:, 0]
        share = covered / np.maximum(masks.sum(axis=(1, 2)), 1.0)[:, None, None]
        return np.where(share >= MIN_OVERLAP, scores, -np.inf)


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
