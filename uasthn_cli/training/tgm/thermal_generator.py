"""A trained generator at work on single windows."""

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from uasthn_cli.matching.device import choose_device
from uasthn_cli.training.tgm.pairs import as_tensor, grey_levels
from uasthn_cli.training.tgm.weights import TrainedGenerator, load_generator

_SAME_SCALE: Final = 0.05


class ThermalGenerator:
    """Draws thermal images; the same window gives the same image every time.

    pix2pix leaves its dropout on when it draws; here it is off, so that results repeat.
    """

    def __init__(self, trained: TrainedGenerator, device: str = "cpu") -> None:
        """Take a trained generator to a device."""
        self._network = trained.network.to(device).eval()
        self._device = device
        self._architecture = trained.architecture
        self.size_px = trained.size_px
        self.gsd_m = trained.gsd_m

    @classmethod
    def open(cls, path: Path, device: str = "auto") -> "ThermalGenerator":
        """Read weights written by ``uasthn tgm train``.

        Raises:
            WeightsError: missing, not safetensors, or of another kind of network.
        """
        return cls(load_generator(path), choose_device(device))

    def render(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the thermal image ``(h, w)`` of a window ``(h, w, 3)`` at about ``gsd_m``.

        Any size: the window is mirrored beyond its right and lower edges as far as the network
        needs. Its norms look at the whole window, so a window's grey depends on all that it shows.

        Raises:
            ValueError: the window is not ``(h, w, 3)`` of 8 bits, or empty.
        """
        if rgb.ndim != 3 or rgb.shape[-1] != 3 or rgb.dtype != np.uint8 or 0 in rgb.shape:
            raise ValueError(f"not a window of 8-bit colours: {rgb.shape}, {rgb.dtype}")
        height_px, width_px = rgb.shape[:2]
        below, right = self._missing_px(height_px), self._missing_px(width_px)
        padded = np.asarray(
            cv2.copyMakeBorder(rgb, 0, below, 0, right, cv2.BORDER_REFLECT_101), dtype=np.uint8
        )
        with torch.no_grad():
            drawn = self._network(as_tensor(padded[None]).to(self._device))
        return grey_levels(drawn[0, 0, :height_px, :width_px])

    def _missing_px(self, side_px: int) -> int:
        """Return how many pixels a side lacks to be one that the network takes."""
        stride_px = self._architecture.stride_px
        return max(self._architecture.smallest_px - side_px, -side_px % stride_px)

    def pixels_of(self, length_m: float) -> int:
        """Return how many pixels of the generator's own a length on the ground is, at least 1."""
        return max(1, round(length_m / self.gsd_m))

    def is_own_scale(self, gsd_m: float) -> bool:
        """Tell whether a resolution is within 5 % of the one that the generator knows."""
        return abs(math.log(gsd_m / self.gsd_m)) < _SAME_SCALE


@dataclass(frozen=True, slots=True)
class GeneratorFile:
    """A generator at work, and the file it comes from."""

    name: str
    sha256: str
    generator: ThermalGenerator


def open_generator_file(path: Path, device: str) -> GeneratorFile:
    """Read weights written by ``uasthn tgm train``, and say which they are.

    Raises:
        WeightsError: missing, not safetensors, or of another kind of network.
    """
    generator = ThermalGenerator.open(path, device)
    return GeneratorFile(path.name, hashlib.sha256(path.read_bytes()).hexdigest(), generator)
