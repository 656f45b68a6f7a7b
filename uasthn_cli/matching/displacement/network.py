"""What every displacement network offers, so that CropTTA, ensembles and two stages need one code.

Images are ``(B, 3, 256, 256)`` in 0..1, thermal ones with three equal channels.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor


@dataclass(frozen=True, slots=True)
class Refinement:
    """Displacements ``(iterations, B, 4, 2)`` of the corners, in pixels of W_R, after each step.

    ``log_variances`` of the same shape come from a Direct Modeling head, None without one.
    """

    displacements: Tensor
    log_variances: Tensor | None = None

    @property
    def last(self) -> Tensor:
        """Displacements ``(B, 4, 2)`` after the last step."""
        return self.displacements[-1]

    @property
    def deviations(self) -> Tensor | None:
        """Standard deviations ``(B, 4, 2)`` that the head gives the last step, in pixels of W_R."""
        return None if self.log_variances is None else torch.exp(0.5 * self.log_variances[-1])


class Pairing(Protocol):
    """A satellite image's features, brought together with thermal views."""

    def first(self, count: int) -> "Pairing":
        """Return the pairing of the first ``count`` thermal images."""


class DisplacementNetwork(Protocol):
    """A network whose satellite branch is computed once, however many views are looked up."""

    is_iterative: bool

    def encode_satellite(self, satellite: Tensor) -> Tensor:
        """Return features of satellite images ``(B, 3, 256, 256)``."""

    def pair(self, satellite_features: Tensor, thermal: Tensor) -> Any:
        """Bring features of B satellite images together with ``N * B`` thermal images.

        View ``n`` of sample ``b`` is number ``n * B + b``.
        """

    def refine(
        self,
        pairing: Any,
        iterations: int,
        start: Tensor | None = None,
        *,
        is_lookup_held: bool = False,
    ) -> Refinement:
        """Take steps from displacements ``(N * B, 4, 2)`` (default 0).

        With ``is_lookup_held`` every step looks where the first one does.
        """
