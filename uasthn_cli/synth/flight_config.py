"""What a rendered flight is made of: place, aircraft, camera, and what the GPS gets wrong.

Every default of the workshop, free of heavy imports.
"""

import math
from dataclasses import dataclass, field
from pathlib import Path

from uasthn_cli.errors import SyntheticFlightError
from uasthn_cli.synth.aircraft_errors import AircraftErrors
from uasthn_cli.synth.kinds import Gain, LandscapeKind, Route, StressCategory

_MOST_RELIEF_PER_HEIGHT = 0.75
"""The ground may lie on one side of its mean: a quarter of the height stays clear at least."""

_LENS_CLEARANCE = 0.95


@dataclass(frozen=True, slots=True)
class SensorConfig:
    """One camera. ``pattern_seed`` fixes what stays the same from frame to frame.

    ``blur_px`` is the deviation of the optics' and detector's spread; ``vignetting_k`` the
    difference of corners and centre; ``least_span_k`` keeps gain control from blowing up noise;
    ``plateau`` is the largest share of pixels one histogram bin may claim.
    """

    blur_px: float = 0.7
    netd_k: float = 0.05
    column_pattern_k: float = 0.015
    row_pattern_k: float = 0.010
    pixel_pattern_k: float = 0.015
    vignetting_k: float = 0.25
    dead_pixel_share: float = 2e-5
    gain: Gain = Gain.PLATEAU
    plateau: float = 0.006
    least_span_k: float = 5.0
    pattern_seed: int = 0


@dataclass(frozen=True, slots=True)
class FlightConfig:
    """One flight; equal values give equal bytes.

    ``overlap`` is the share of a frame that the next one (and the next lane's) sees again;
    ``drift_m`` the farthest that the logged position strays, ``yaw_bias_deg`` and ``height_bias``
    the most its heading and height are off. ``map_crs`` is a CRS such as ``EPSG:4326`` (None: the
    place's UTM zone); ``jpeg_map`` compresses the map with loss. With relief, ``height_m`` is the
    height above the mean ground.
    """

    seed: int = 1
    kind: LandscapeKind = LandscapeKind.MIXED
    frames: int = 60
    frame_width_px: int = 640
    frame_height_px: int = 512
    hfov_deg: float = 45.0
    height_m: float = 300.0
    map_gsd_m: float = 1.0
    route: Route = Route.SURVEY
    overlap: float = 0.5
    airspeed_m_s: float = 18.0
    wind_m_s: float = 5.0
    drift_m: float = 80.0
    yaw_bias_deg: float = 2.0
    height_bias: float = 0.03
    largest_tilt_deg: float = 4.0
    lat_deg: float = 46.95
    lon_deg: float = -99.15
    map_crs: str | None = None
    jpeg_map: bool = False
    camera_messages: bool = False
    start_utc_s: float = 1_763_800_000.0
    sensor: SensorConfig = field(default_factory=SensorConfig)
    errors: AircraftErrors = field(default_factory=AircraftErrors)

    def __post_init__(self) -> None:
        """Refuse what cannot be flown.

        Raises:
            SyntheticFlightError: a value is out of its range; the message says which.
        """
        checks = {
            f"{self.frames} frames: at least one is needed": self.frames >= 1,
            f"frames of {self.frame_width_px} × {self.frame_height_px} px: at least 32 × 32": min(
                self.frame_width_px, self.frame_height_px
            )
            >= 32,
            f"field of view {self.hfov_deg}°: between 5 and 120": 5 <= self.hfov_deg <= 120,
            f"height {self.height_m} m: between 10 and 5000": 10 <= self.height_m <= 5000,
            f"map GSD {self.map_gsd_m} m: between 0.05 and 50": 0.05 <= self.map_gsd_m <= 50,
            f"overlap {self.overlap}: between 0 and 0.95": 0 <= self.overlap <= 0.95,
            f"wind of {self.wind_m_s} m/s: no more than 0.8 of the airspeed": 0
            <= self.wind_m_s
            <= 0.8 * self.airspeed_m_s,
            f"drift {self.drift_m} m: at least 0": self.drift_m >= 0,
            f"place {self.lat_deg}, {self.lon_deg}: latitude within ±80": abs(self.lat_deg) <= 80
            and abs(self.lon_deg) <= 180,
            f"relief of {self.errors.relief_m:g} m under {self.height_m:g} m of height: no more"
            f" than {_MOST_RELIEF_PER_HEIGHT:g} of it": self.errors.relief_m
            <= _MOST_RELIEF_PER_HEIGHT * self.height_m,
            f"lens k1 {self.errors.lens_k1:g}: no ray arrives at the corners of frames"
            " so wide": self._corner_focals < _LENS_CLEARANCE * self.errors.lens_folds_at(),
            "camera messages lost but none written: add --camera-messages": self.camera_messages
            or not self.errors.lose_messages,
        }
        for message, holds in checks.items():
            if not holds:
                raise SyntheticFlightError(f"cannot render a flight with {message}")

    @property
    def footprint_m(self) -> tuple[float, float]:
        """Width and length on the ground of a frame that looks straight down."""
        width_m = 2.0 * self.height_m * math.tan(math.radians(self.hfov_deg) / 2.0)
        return width_m, width_m * self.frame_height_px / self.frame_width_px

    @property
    def frame_gsd_m(self) -> float:
        """Ground metres per frame pixel."""
        return self.footprint_m[0] / self.frame_width_px

    @property
    def crs(self) -> str:
        """The map's CRS: the one given, or the UTM zone of the place."""
        return self.utm_crs if self.map_crs is None else self.map_crs

    @property
    def utm_crs(self) -> str:
        """The UTM zone of the place."""
        zone = min(60, int((self.lon_deg + 180.0) // 6.0) + 1)
        return f"EPSG:{(32600 if self.lat_deg >= 0.0 else 32700) + zone}"

    @property
    def _corner_focals(self) -> float:
        """Distance of a frame's corner from its centre in focal lengths."""
        half_width = math.tan(math.radians(self.hfov_deg) / 2.0)
        return half_width * math.hypot(1.0, self.frame_height_px / self.frame_width_px)


@dataclass(frozen=True, slots=True)
class StressConfig:
    """What to make wrong with a flight, and how much: ``severity`` 0 (nothing) to 1.

    ``donors`` are GeoTIFFs of other places that replace ground of the map; without any, landscapes
    are rendered for that. A wrong place is wrong altogether at any severity above 0.
    """

    category: StressCategory
    severity: float = 1.0
    seed: int = 0
    donors: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        """Refuse a severity that has no meaning.

        Raises:
            SyntheticFlightError: it is not within 0 and 1.
        """
        if not 0.0 <= self.severity <= 1.0:
            raise SyntheticFlightError(f"severity {self.severity} of {self.category}: 0 to 1")
