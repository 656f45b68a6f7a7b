"""How pairs are cut from a source: the settings that all sources share."""

from dataclasses import dataclass, field

from uasthn_cli.config import GeotagConfig
from uasthn_cli.ingest.cameras import CameraSpec

DEFAULT_WINDOW_M = 1536.0
"""W_S of the paper, at its 1 m a pixel."""

DEFAULT_THERMAL_M = 512.0
"""W_T of the paper."""

DEFAULT_OFFSET_M = 512.0
"""The largest D_C of the paper."""

SPLITS = ("train", "val", "test", "extended")
"""Parts of Boson-nighttime; other sources have no parts."""


@dataclass(frozen=True, slots=True)
class DatasetSpec:
    """What to cut out of a source.

    ``window_m`` is W_S, ``thermal_m`` W_T, ``max_offset_m`` D_C, all on the ground; None takes the
    paper's, or what a flight's log says. ``samples`` None takes all there are (rendered sources
    never end: 100). ``split`` and ``exclude_validation`` are of Boson-nighttime, ``camera`` of
    flights, ``yaw_error_deg`` and ``scale_error`` (standard deviations) of rendered pairs.
    """

    window_m: float | None = None
    thermal_m: float = DEFAULT_THERMAL_M
    max_offset_m: float | None = None
    gsd_m: float | None = None
    samples: int | None = None
    seed: int = 0
    split: str = "test"
    exclude_validation: bool = False
    camera: CameraSpec = field(default_factory=CameraSpec)
    yaw_error_deg: float = 0.0
    scale_error: float = 0.0

    @property
    def largest_offset_m(self) -> float:
        """D_C, or the paper's largest."""
        return DEFAULT_OFFSET_M if self.max_offset_m is None else self.max_offset_m

    @property
    def satellite_m(self) -> float:
        """W_S, or the paper's."""
        return DEFAULT_WINDOW_M if self.window_m is None else self.window_m

    def flight_window_m(self, thermal_m: float) -> float:
        """Return W_S of a flight: the one given, or just large enough for the search."""
        if self.window_m is not None:
            return self.window_m
        reach_m = self.max_offset_m or GeotagConfig().search_radius_m
        return thermal_m + 2.0 * reach_m
