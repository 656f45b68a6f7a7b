"""STHN: a second IHN looks at the first one's bounding box (Xiao et al. 2024; paper, sec. II)."""

from dataclasses import dataclass

from torch import Tensor, nn

from uasthn_cli.config import RESIZED_WIDTH_PX
from uasthn_cli.matching.displacement.homography import (
    displacement_at_resized,
    resize_to_network,
    sample_boxes,
    square_corners,
)
from uasthn_cli.matching.displacement.ihn import (
    ITERATIONS,
    IhnArchitecture,
    IterativeHomographyNetwork,
)
from uasthn_cli.matching.displacement.network import Refinement

SECOND_STAGE_LEVELS = 2

BOX_PADDING = 32 / 1536
"""By how much of the satellite image's width the box grows on each side: the paper's 64 in all."""


@dataclass(frozen=True, slots=True)
class SecondLook:
    """What the second stage saw: boxes, its own displacements in them, and the answer.

    ``boxes_px`` ``(B, 4, 2)`` in pixels of the full satellite image; ``fine`` in pixels of the
    resized box; ``displacement`` ``(B, 4, 2)`` in pixels of W_R, as the first stage's.
    """

    boxes_px: Tensor
    fine: Refinement
    displacement: Tensor


class TwoStageHomographyNetwork(nn.Module):
    """Module names are those of published weights: ``netG`` and ``netG_fine``."""

    def __init__(
        self,
        first: IhnArchitecture | None = None,
        second: IhnArchitecture | None = None,
    ) -> None:
        """Build both stages with random weights."""
        super().__init__()
        self.netG = IterativeHomographyNetwork(first)
        self.netG_fine = IterativeHomographyNetwork(
            second or IhnArchitecture(levels=SECOND_STAGE_LEVELS)
        )

    def look_again(
        self,
        satellite: Tensor,
        thermal: Tensor,
        displacement: Tensor,
        iterations: int = ITERATIONS,
        padding: float = BOX_PADDING,
    ) -> SecondLook:
        """Improve the first stage's displacements ``(B, 4, 2)``.

        ``satellite`` ``(B, 3, S, S)`` is not resized, ``thermal`` ``(B, 3, 256, 256)`` is;
        ``padding`` is a share of S.
        """
        return look_again(self.netG_fine, satellite, thermal, displacement, iterations, padding)

    def forward(
        self, satellite: Tensor, thermal: Tensor, iterations: int = ITERATIONS
    ) -> tuple[Refinement, SecondLook]:
        """Locate thermal images ``(B, 3, 256, 256)`` in satellite images ``(B, 3, S, S)``."""
        coarse = self.netG(resize_to_network(satellite), thermal, iterations)
        return coarse, self.look_again(satellite, thermal, coarse.last, iterations)


def look_again(
    network: IterativeHomographyNetwork,
    satellite: Tensor,
    thermal: Tensor,
    displacement: Tensor,
    iterations: int = ITERATIONS,
    padding: float = BOX_PADDING,
) -> SecondLook:
    """Let a second stage look; see :meth:`TwoStageHomographyNetwork.look_again`."""
    width_px = satellite.shape[-1]
    boxes_px = bounding_boxes(displacement, width_px, padding * width_px)
    fine = network(sample_boxes(satellite, boxes_px), thermal, iterations)
    return SecondLook(boxes_px, fine, displacement_of_boxes(boxes_px, fine.last, width_px))


def bounding_boxes(displacement: Tensor, width_px: int, padding_px: float) -> Tensor:
    """Return square boxes ``(B, 4, 2)`` around displaced corners, in pixels of the full image.

    As published: a pixel of the resized image covers ``width_px / W_R`` pixels, so a box's first
    pixel is the first one covered and its last the last one.
    """
    scale = width_px / RESIZED_WIDTH_PX
    corners = square_corners(RESIZED_WIDTH_PX, displacement) + displacement
    first, last = corners.amin(dim=1) * scale, (corners.amax(dim=1) + 1.0) * scale - 1.0
    middle = 0.5 * (first + last)
    half = 0.5 * (last - first).amax(dim=1, keepdim=True) + padding_px
    signs = 2.0 * square_corners(2, displacement) - 1.0
    return middle[:, None] + signs * half[:, None]


def displacement_of_boxes(boxes_px: Tensor, fine: Tensor, width_px: int) -> Tensor:
    """Return displacements ``(B, 4, 2)`` in the full image, at W_R, from those in its boxes.

    Displacements grow as widths do (:func:`corners_at_width`).
    """
    sides_px = boxes_px[:, 3, 0] - boxes_px[:, 0, 0] + 1.0
    corners_px = boxes_px + fine * (sides_px / RESIZED_WIDTH_PX)[:, None, None]
    return displacement_at_resized(corners_px, width_px)
