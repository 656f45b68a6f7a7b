"""IHN: iterated displacement of four corners (Cao et al., CVPR 2022), as the authors use it."""

from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor, nn

from uasthn_cli.config import RESIZED_WIDTH_PX
from uasthn_cli.matching.displacement.correlation import CHANNELS_PER_LEVEL, CorrelationPyramid
from uasthn_cli.matching.displacement.encoder import FeatureEncoder
from uasthn_cli.matching.displacement.homography import (
    map_points,
    solve_homography,
    square_corners,
)
from uasthn_cli.matching.displacement.network import Refinement
from uasthn_cli.matching.displacement.update import UpdateBlock

ITERATIONS = 6
"""K_1 and K_2 of the paper."""

STRIDE_PX = 4
CELLS = RESIZED_WIDTH_PX // STRIDE_PX


@dataclass(frozen=True, slots=True)
class IhnArchitecture:
    """Size of an IHN; the defaults are those of the published first stage.

    ``levels`` of the correlation pyramid are 4 in the first stage and 2 in the second;
    ``has_uncertainty_head`` adds Direct Modeling's second update block.
    """

    levels: int = 4
    has_uncertainty_head: bool = False
    block_widths: tuple[int, int] = (64, 96)
    feature_channels: int = 256
    update_channels: int = 128

    def as_metadata(self) -> dict[str, Any]:
        """Return the architecture as JSON can hold it."""
        return asdict(self)


class IterativeHomographyNetwork(nn.Module):
    """Module names are those of published weights, so that their state dict loads."""

    is_iterative = True

    def __init__(self, architecture: IhnArchitecture | None = None) -> None:
        """Build a network with random weights."""
        super().__init__()
        self.architecture = architecture = architecture or IhnArchitecture()
        channels_in = architecture.levels * CHANNELS_PER_LEVEL + 2
        self.fnet1 = FeatureEncoder(architecture.block_widths, architecture.feature_channels)
        self.update_block_4 = UpdateBlock(channels_in, architecture.update_channels)
        if architecture.has_uncertainty_head:
            self.ue_update_block_4 = UpdateBlock(channels_in, architecture.update_channels)

    def encode_satellite(self, satellite: Tensor) -> Tensor:
        """Images ``(B, 3, 256, 256)`` in 0..1 to features ``(B, C, 64, 64)``."""
        features: Tensor = self.fnet1(satellite)
        return features

    def pair(self, satellite_features: Tensor, thermal: Tensor) -> CorrelationPyramid:
        """Correlate B satellite images with ``N * B`` thermal ones ``(N * B, 3, 256, 256)``."""
        return CorrelationPyramid.of(
            satellite_features, self.fnet1(thermal), self.architecture.levels
        )

    def refine(
        self,
        pairing: CorrelationPyramid,
        iterations: int,
        start: Tensor | None = None,
        *,
        is_lookup_held: bool = False,
    ) -> Refinement:
        """Take steps from displacements ``(B, 4, 2)`` (default 0).

        With ``is_lookup_held`` every step looks where the first one does. No gradient flows through
        the places looked at, as in RAFT (Teed & Deng 2020): only through what is seen there.
        """
        finest = pairing.levels[0]
        # where correlations are in half precision (training), displacements must not be
        exact = torch.promote_types(finest.dtype, torch.float32)
        displacement = finest.new_zeros(len(finest), 4, 2, dtype=exact) if start is None else start
        still = looked_at(torch.zeros_like(displacement[:1]))
        places = looked_at(displacement.detach())
        steps, variances = [], []
        for step in range(iterations):
            if step and not is_lookup_held:
                places = looked_at(displacement.detach())
            seen, flow = pairing.look_up(places), places - still
            displacement = displacement + self.update_block_4(seen, flow)
            steps.append(displacement)
            if self.architecture.has_uncertainty_head:
                variances.append(self.ue_update_block_4(seen, flow))
        return Refinement(torch.stack(steps), torch.stack(variances) if variances else None)

    def forward(
        self, satellite: Tensor, thermal: Tensor, iterations: int = ITERATIONS
    ) -> Refinement:
        """Locate thermal images ``(N * B, 3, 256, 256)`` in satellite images of the same kind."""
        return self.refine(self.pair(self.encode_satellite(satellite), thermal), iterations)


def looked_at(displacement: Tensor) -> Tensor:
    """Return the place in the thermal grid ``(B, 64, 64, 2)`` that each satellite cell looks at.

    The corners of the grid move by a quarter of the displacements ``(B, 4, 2)``.
    """
    corners = square_corners(CELLS, displacement).expand_as(displacement)
    H = solve_homography(corners, corners + displacement / STRIDE_PX)
    steps = torch.arange(CELLS, device=displacement.device, dtype=H.dtype)
    cells = torch.stack(torch.meshgrid(steps, steps, indexing="xy"), dim=-1)
    places = map_points(H, cells.reshape(1, -1, 2).expand(len(H), -1, -1))
    return places.reshape(-1, CELLS, CELLS, 2).to(displacement.dtype)
