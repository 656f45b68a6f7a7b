"""Mutual information: any relation between grey values will do, not only a linear one."""

from collections.abc import Iterable
from enum import StrEnum

import cv2
import numpy as np
from scipy.fft import irfft2, rfft2
from shift_search import ShiftSearch, fft_size, inside_window

from uasthn_cli.types import BoolArray, FloatArray, ImageArray, MapFeatures, Ortho

_BINS = 8
_QUANTILES = 256
_LOCAL_PX = 3.0
_CONTRAST_FLOOR = 0.1


class MiChannel(StrEnum):
    """What is compared: brightness, or brightness over its local mean and contrast."""

    GREY = "grey"
    LOCAL = "local"


class MutualInformationEstimator(ShiftSearch):
    """Viola & Wells (1997) at every shift and full resolution.

    Grey values are spread over eight bins of equal population, each over its two nearest ones; the
    joint histogram at all shifts at once is the correlation of the bins' images (by FFT). Bins and
    the scale of local contrast were chosen on flights that ``uasthn synth`` renders.
    """

    def __init__(self, channel: MiChannel = MiChannel.GREY) -> None:
        """Compare brightness or local contrast."""
        self._channel = channel
        self.name = "mi" if channel is MiChannel.GREY else f"mi-{channel}"

    def scores(self, features: MapFeatures, thermal: Ortho, masks: ImageArray) -> list[FloatArray]:
        """Return mutual information in nats at every shift."""
        size = fft_size(features.valid.shape)
        in_window = rfft2(self._bins(features.values[0], features.valid), s=size)
        in_ortho = self._bins(thermal.image, thermal.valid)
        found = []
        for mask in masks:
            in_view = np.conj(rfft2(in_ortho * mask, s=size))
            joint = (
                inside_window(irfft2(bin_ * in_view, s=size), features, thermal)
                for bin_ in in_window
            )
            found.append(mutual_information(np.maximum(counts, 0.0) for counts in joint))
        return found

    def _bins(self, image: FloatArray | ImageArray, valid: BoolArray) -> ImageArray:
        """Return how much of each pixel falls into each bin ``(bins, h, w)``, 0 if not valid."""
        grey = image.astype(np.float32)
        if self._channel is MiChannel.LOCAL:
            grey = _local_contrast(grey, valid)
        if not valid.any():
            return np.zeros((_BINS, *grey.shape), np.float32)
        ranks = np.linspace(0.0, _BINS - 1.0, _QUANTILES + 1)
        position = np.interp(grey, np.quantile(grey[valid], ranks / ranks[-1]), ranks)
        distance = np.abs(position - np.arange(_BINS)[:, None, None])
        return (np.maximum(1.0 - distance, 0.0) * valid).astype(np.float32)


def mutual_information(joint: Iterable[FloatArray]) -> FloatArray:
    """Return mutual information in nats by the rows ``(columns, ...)`` of a joint histogram.

    A histogram need not be normalised; one that is empty has none.
    """
    in_cells, in_rows, columns = np.zeros(()), np.zeros(()), np.zeros(())
    for row in joint:
        in_cells = in_cells + _x_log_x(row).sum(axis=0)
        in_rows = in_rows + _x_log_x(row.sum(axis=0))
        columns = columns + row
    total = np.maximum(columns.sum(axis=0), 1e-6)
    in_columns = _x_log_x(columns).sum(axis=0)
    information: FloatArray = (in_cells - in_rows - in_columns) / total + np.log(total)
    return information


def _x_log_x(x: FloatArray) -> FloatArray:
    product: FloatArray = x * np.log(np.maximum(x, 1e-12))
    return product


def _local_contrast(grey: ImageArray, valid: BoolArray) -> ImageArray:
    """Return an image less its local mean, over its local deviation; 0 where not valid."""

    def blurred(array: ImageArray) -> ImageArray:
        smooth: ImageArray = cv2.GaussianBlur(array, (0, 0), _LOCAL_PX).astype(np.float32)
        return smooth

    mask = valid.astype(np.float32)
    weight: ImageArray = np.maximum(blurred(mask), np.float32(1e-3))
    centred: ImageArray = (grey - blurred(grey * mask) / weight) * mask
    deviation: ImageArray = np.sqrt(blurred(centred * centred) / weight)
    floor = np.float32(_CONTRAST_FLOOR * deviation.mean() + 1e-6)
    contrast: ImageArray = centred / (deviation + floor)
    return contrast
