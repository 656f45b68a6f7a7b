"""The vocabulary that the rooms exchange: frozen, slotted, free of heavy imports.

Conventions (see ``CONVENTIONS.md``): image points are ``(x, y)`` with the centre of the top-left
pixel at (0, 0); corners are ordered top-left, top-right, bottom-left, bottom-right in arrays
``(..., 4, 2)``; ``H_a_b`` maps points of ``a`` to points of ``b``; every physical quantity carries
its unit in its name.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ImageArray = NDArray[np.float32]
BoolArray = NDArray[np.bool_]

LEAST_LOG = -60.0  # log-likelihoods below are equally impossible
LOG_OF_LEVEL: ImageArray = (LEAST_LOG * (np.arange(256) / 255.0) ** 2).astype(np.float32)


class Reason(StrEnum):
    """Why a frame was rejected, or has no estimate at all."""

    UNCERTAIN = "uncertain"
    AMBIGUOUS = "ambiguous"
    RISKY = "risky"
    UNSUPPORTED = "unsupported"
    OFF_MAP = "off-map"
    NO_PRIOR = "no-prior"
    NO_TIME = "no-time"
    UNREADABLE = "unreadable"
    OUTSIDE_LOG = "outside-log"
    TOO_OBLIQUE = "too-oblique"
    TEXTURELESS = "textureless"
    DEGENERATE_HOMOGRAPHY = "degenerate-homography"
    IMPLAUSIBLE_SCALE = "implausible-scale"


class Source(StrEnum):
    """What an answer rests on: the frame alone, or the whole flight."""

    FIX = "fix"
    FUSED = "fused"


@dataclass(frozen=True, slots=True)
class Attitude:
    """Orientation of a body against north-east-down, MAVLink ``ATTITUDE`` convention (radians)."""

    roll_rad: float
    pitch_rad: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class CameraModel:
    """A pinhole camera with OpenCV distortion, for frames of one size.

    The mount turns the camera against the body as an attitude turns a body against the ground: yaw
    first, clockwise about the down axis, then pitch, then roll. All 0 means that the camera looks
    along the body's down axis, the top of the image being the nose of the aircraft.
    """

    width_px: int
    height_px: int
    focal_x_px: float
    focal_y_px: float
    principal_x_px: float
    principal_y_px: float
    distortion: tuple[float, ...] = ()
    mount_yaw_rad: float = 0.0
    mount_roll_rad: float = 0.0
    mount_pitch_rad: float = 0.0

    @property
    def mount(self) -> Attitude:
        """How the camera is turned against the body."""
        return Attitude(self.mount_roll_rad, self.mount_pitch_rad, self.mount_yaw_rad)


@dataclass(frozen=True, slots=True)
class FrameFile:
    """One image on disk; ``name`` is its path relative to the frames folder."""

    name: str
    path: Path


@dataclass(frozen=True, slots=True)
class Prior:
    """What the log says about one frame: where the camera was and how it was turned.

    ``attitude`` is the camera's own (gimbal angles applied where the log has them, mount yaw not
    yet applied). ``height_source`` names the field that gave the height over ground;
    ``alt_amsl_m`` is the logged altitude above mean sea level, NaN where the log has none,
    ``above_start_m`` that above take-off. Over an elevation model, ``ground_m`` is its height of
    the flat ground that the height is counted from; None: ground is flat.
    """

    frame: FrameFile
    time_utc_s: float
    lat_deg: float
    lon_deg: float
    height_above_ground_m: float
    attitude: Attitude
    height_source: str
    alt_amsl_m: float = math.nan
    above_start_m: float = math.nan
    ground_m: float | None = None


@dataclass(frozen=True, slots=True)
class FrameFailure:
    """A frame without an estimate: the reason from the fixed list and one line of detail."""

    frame: FrameFile
    reason: Reason
    detail: str
    time_utc_s: float | None = None
    prior: Prior | None = None


@dataclass(frozen=True, slots=True)
class Ortho:
    """A thermal frame rectified to the ground plane: north-up, at ``gsd_m`` metres a pixel.

    ``image`` ``(h, w)`` float32 is zero where ``valid`` ``(h, w)`` is false. ``H_frame_ortho``
    ``(3, 3)`` maps frame pixels to ortho pixels; ``nadir_px`` ``(2,)`` is the ortho pixel of the
    ground point straight below the camera, as the prior has it.
    """

    image: ImageArray
    valid: BoolArray
    gsd_m: float
    H_frame_ortho: FloatArray
    nadir_px: FloatArray


@dataclass(frozen=True, slots=True)
class GridBox:
    """A box of whole pixels on the flight's map grid (column to the east, row to the south)."""

    column_px: int
    row_px: int
    width_px: int
    height_px: int


@dataclass(frozen=True, slots=True)
class MapGrid:
    """The north-up pixel grid on which a flight's map is read.

    Grid pixel ``(column, row)`` has its centre ``(column * gsd_m, -row * gsd_m)`` metres east and
    north of the origin of the flight's local CRS.
    """

    gsd_m: float


@dataclass(frozen=True, slots=True)
class MapStatistics:
    """Colour statistics of the whole map: mean per channel ``(3,)`` and one deviation, in 0..1."""

    mean: tuple[float, float, float]
    deviation: float


@dataclass(frozen=True, slots=True)
class MapWindow:
    """A piece of the map: ``image`` ``(h, w, 3)`` float32 in 0..1, ``valid`` ``(h, w)``.

    Pixels outside the map or without data are 0 in ``image`` and false in ``valid``.
    """

    image: ImageArray
    valid: BoolArray
    box: GridBox
    grid: MapGrid
    statistics: MapStatistics


@dataclass(frozen=True, slots=True)
class MapFeatures:
    """What an estimator made of a map window: ``values`` ``(channels, h / stride, w / stride)``.

    Cell ``(0, 0)`` covers the window's top-left ``stride × stride`` pixels; ``valid`` has the shape
    of one channel.
    """

    values: NDArray[np.floating[Any]]
    valid: BoolArray
    box: GridBox
    grid: MapGrid
    stride_px: int


@dataclass(frozen=True, slots=True)
class OffsetLikelihood:
    """How well a frame fits the map for every error of its prior's position.

    ``levels`` ``(n, n)`` uint8, 0 where it fits best: rows go south, columns east, ``cell_m``
    apart; the middle one is the prior moved by ``centre_m`` ``(2,)`` (east, north). Level ``k``
    is a log-likelihood of ``LEAST_LOG * (k / 255)²``: one of ``l`` is off by ``0.031 sqrt(-l)``.
    """

    levels: NDArray[np.uint8]
    cell_m: float
    centre_m: FloatArray

    @classmethod
    def of(
        cls, log_likelihood: NDArray[np.floating[Any]], cell_m: float, centre_m: FloatArray
    ) -> "OffsetLikelihood":
        """Return log-likelihoods ``(n, n)``, largest 0, rounded to their levels."""
        steps = np.sqrt(np.clip(np.asarray(log_likelihood) / LEAST_LOG, 0.0, 1.0)) * 255.0
        return cls(np.rint(steps).astype(np.uint8), cell_m, centre_m)

    @property
    def log_likelihood(self) -> ImageArray:
        """Log-likelihoods ``(n, n)``, largest 0."""
        return LOG_OF_LEVEL[self.levels]


@dataclass(frozen=True, slots=True)
class Trust:
    """What is known of an answer's error.

    ``confidence`` in 0..1 is the posterior mass within 25 m of the answer, ``entropy_nats`` and
    ``sigma_m`` (root mean square per axis) describe the whole posterior. ``covariance_m2``
    ``(2, 2)`` (east, north) is that of the centre near the answer, ``ce90_m`` the radius that holds
    90 % of errors, ``risk`` the estimated probability of an error beyond the tolerance (NaN without
    a calibration), ``agreement_m`` the distance between the frame's own and the flight's answer,
    ``support`` in 0..1 the share of near frames that alone agree with the flight's answer, each
    counted as sure as it is.
    """

    confidence: float
    entropy_nats: float
    sigma_m: float
    covariance_m2: FloatArray
    ce90_m: float
    risk: float
    agreement_m: float
    support: float


@dataclass(frozen=True, slots=True)
class Spread:
    """Agreement on one frame after each view was carried back to it (paper, eqs. 1-5).

    ``recovered_px`` ``(N, 4, 2)`` by view, ``corners_px`` ``(4, 2)`` aggregated, ``std_px``
    ``(4, 2)`` standard deviation per corner coordinate, by the run's method of uncertainty
    estimation; all in window pixels.
    """

    recovered_px: FloatArray
    corners_px: FloatArray
    std_px: FloatArray


@dataclass(frozen=True, slots=True)
class Fix:
    """Where one frame was taken, in WGS 84 degrees and ground metres.

    ``corners_deg`` ``(4, 2)`` holds ``(lat, lon)`` of the frame's corners, ``corner_std_m``
    ``(4, 2)`` the standard deviation of each corner east-west and north-south by the run's method
    of uncertainty estimation: among views, among networks, or as the network itself has it.
    ``detail`` says of a rejected answer in one line what was missing, and by how much. ``single``
    is the frame's own answer where this one rests on the whole flight.

    ``roll_deg``, ``pitch_deg``, ``yaw_deg`` are the camera's: the attitude of a body to which a
    nadir camera is bolted with the top of its image forward. ``height_above_ground_m`` is the
    height that placed the frame, ``alt_amsl_m`` the logged altitude at its time.
    ``camera_covariance_m2`` ``(2, 2)`` (east, north) and ``camera_ce90_m`` are the camera's
    position's, as ``trust`` has those of the centre.
    """

    prior: Prior
    lat_deg: float
    lon_deg: float
    center_lat_deg: float
    center_lon_deg: float
    corners_deg: FloatArray
    corner_std_m: FloatArray
    uncertainty_m: float
    offset_m: float
    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    height_above_ground_m: float
    alt_amsl_m: float
    gsd_m: float
    trust: Trust
    camera_covariance_m2: FloatArray
    camera_ce90_m: float
    accepted: bool
    reason: Reason | None
    detail: str = ""
    source: Source = Source.FIX
    single: "Fix | None" = None


FrameResult = Fix | FrameFailure


@dataclass(frozen=True, slots=True)
class Located:
    """What one frame gave alone: its result, and how well it fits everywhere (None: nothing)."""

    result: FrameResult
    likelihood: OffsetLikelihood | None


@dataclass(frozen=True, slots=True)
class RefinedFrame:
    """What a frame shows near the place the flight has it at.

    ``camera`` is None for a frame that cannot be read, ``likelihood`` where it fits nothing.
    """

    frame: FrameFile
    camera: CameraModel | None
    likelihood: OffsetLikelihood | None
