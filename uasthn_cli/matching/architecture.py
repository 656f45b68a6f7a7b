"""Sizes of the learned cross-correlation's encoders: known without loading any of them."""

from dataclasses import asdict, dataclass

STRIDE_PX = 2
"""Image pixels per feature cell."""

TOTAL_STRIDE_PX = 16
"""Deepest down-sampling of the encoder: sizes and tile offsets are multiples of it."""

HALO_PX = 64
"""Context around a map tile beyond which the encoder's response to change is negligible."""


LOCAL_WINDOW_PX = 56
"""Side of the box of a pixel's local mean and contrast."""

POOL_PX = 8
"""The local mean is computed on an image reduced by this: cheap, and the same in every tile."""

SATELLITE_EPSILON = 4e-4
THERMAL_EPSILON = 0.05
"""Added to the local variance: less contrast than this is noise."""


@dataclass(frozen=True, slots=True)
class XcorrArchitecture:
    """Sizes of the two encoders; stored with the weights."""

    feature_channels: int = 8
    widths: tuple[int, int, int, int] = (16, 32, 64, 96)

    def as_metadata(self) -> dict[str, object]:
        """Return a JSON-ready description."""
        return asdict(self)
