"""What every source of pairs yields, whatever its files look like."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.types import FloatArray


@dataclass(frozen=True, slots=True)
class MatchSample:
    """A square satellite image, a square thermal image, and where one lies in the other.

    ``satellite`` ``(S, S, 3)`` uint8 RGB at ``satellite_gsd_m`` metres a pixel, centred where the
    prior believes the thermal image's centre to be, black (0, 0, 0) where there is no data;
    ``thermal`` ``(T, T)`` uint8, as the prior has it north-up at the same metres a pixel;
    ``corners_px`` ``(4, 2)`` the true places of the thermal image's four corner pixels in
    satellite pixels.
    """

    name: str
    satellite: NDArray[np.uint8]
    thermal: NDArray[np.uint8]
    corners_px: FloatArray
    satellite_gsd_m: float


class MatchDataset(Protocol):
    """A fixed, ordered set of samples: the same index gives the same sample every time."""

    def __len__(self) -> int:
        """Return the number of samples."""

    def __getitem__(self, index: int) -> MatchSample:
        """Return one sample, read or rendered when asked for."""
