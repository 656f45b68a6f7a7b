"""Every default of the tool, once."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path


class Sampling(StrEnum):
    """How CropTTA places its crops (paper, sec. III-B)."""

    RANDOM = "random"
    GRID = "grid"


class Aggregation(StrEnum):
    """What becomes the answer: the full frame's own estimate or the mean of all views."""

    ORIGINAL = "original"
    MEAN = "mean"


class Rule(StrEnum):
    """Which of the eight standard deviations must pass the threshold for a rejection.

    ``all`` is the paper's: every one is larger; ``any``: the largest; ``mean``: their mean.
    """

    ALL = "all"
    ANY = "any"
    MEAN = "mean"


class UeMethod(StrEnum):
    """Methods of uncertainty estimation, as the paper's Table I has them."""

    NONE = "none"
    DM = "dm"
    DE = "de"
    CROPTTA = "croptta"
    CROPTTA_DE = "croptta+de"


class Merge(StrEnum):
    """How two uncertainties of one corner become one (paper, eq. 12): the larger by default."""

    MAX = "max"
    MIN = "min"
    ADD = "add"


class TimeBase(StrEnum):
    """Which clock dates the log: decided by evidence, the records' own, or the vehicle's."""

    AUTO = "auto"
    RECORD = "record"
    VEHICLE = "vehicle"


class PairBy(StrEnum):
    """What says which camera message a frame has; ``none``: messages are left alone."""

    AUTO = "auto"
    NAME = "name"
    TIME = "time"
    NUMBER = "number"
    ORDER = "order"
    NONE = "none"


class DemDatum(StrEnum):
    """What ties the log's altitudes to an elevation model.

    ``take-off``: the model's height there and the log's height above it; ``amsl``: the log's
    altitude above sea level; ``flight``: over the whole flight, the log's heights are right on
    average.
    """

    AUTO = "auto"
    TAKE_OFF = "take-off"
    AMSL = "amsl"
    FLIGHT = "flight"


class Precision(StrEnum):
    """Number format of the encoders while training; all else is float32.

    ``auto``: bfloat16 where the hardware computes in it.
    """

    AUTO = "auto"
    FLOAT32 = "float32"
    BFLOAT16 = "bfloat16"


WEIGHTS_FOLDER = Path(__file__).parent / "weights"
"""The weights in the box, and what belongs to them."""

BUNDLED_CALIBRATION = WEIGHTS_FOLDER / "calibration.json"

RESIZED_WIDTH_PX = 256
"""W_R of the paper: the width at which thresholds in pixels are stated."""

TOLERANCE_M = 25.0
"""The paper's tolerance: an answer this near to the truth is right.

Confidence is the posterior mass as near to the answer.
"""

TARGET_RISK = 0.05
"""Share of accepted answers that a calibration lets lie beyond the tolerance."""

CONFIDENCE_LEVEL = 0.9
"""How sure a calibration is of keeping that promise."""

DEFAULT_SYMMETRIES = 1
"""Orientations in which xcorr sees both images (1 to 8): more are slower, and hardly surer."""

COARSE_REFINE_SYMMETRIES = 2
"""The same where a coarse map gives the refinement no finer grid: upright and upside down."""

DEFAULT_MAP_ERROR_M = 4.0
"""Standard deviation, per axis, of the map's own registration: part of every uncertainty."""

DEFAULT_ATTITUDE_ERROR_DEG = 1.0
"""Standard deviation of the camera's roll and of its pitch where the flight does not tell.

Attitude, mount and their alignment together: what an ordinary autopilot and a bolted camera get
wrong. It is part of the uncertainty of the camera's position, not of the frame's centre.
"""

MAP_PIXEL_ERROR = 0.6
"""Standard deviation, per axis and in pixels of the map, of what shadows and shading shift.

It stays the same for a whole flight, so no posterior sees it. Chosen by CE90 on rendered flights,
those of the calibration in the box and the ones that judge it.
"""

PAPER_THERMAL_PX = 512
"""W_T of the paper: the width of a thermal image, in whose pixels it states crop offsets."""

CROP_OFFSET_FRACTION = 32 / PAPER_THERMAL_PX
"""o_c / W_T of the paper."""


@dataclass(frozen=True, slots=True)
class CropTtaConfig:
    """CropTTA: number of views N_C (the original included), how crops are drawn, and the seed."""

    views: int = 5
    sampling: Sampling = Sampling.RANDOM
    offset_fraction: float = CROP_OFFSET_FRACTION
    seed: int = 0


MIN_SUPPORT = 0.6
"""A fused answer needs more than this support: near frames that agree, each as sure as it is alone.

Over maps of other places fusion settles somewhere too, and can be sure of it. Of 135 flights over
wrong maps the largest support was 0.51; of healthy rendered flights the least was 0.94, of real
ones 0.75.
"""

FALLBACK_MAX_STD_M = 10.0
"""Limit on the views' deviation where neither a calibration nor the user gives any."""

FALLBACK_MIN_CONFIDENCE = 0.3
"""Limit on the confidence where neither a calibration nor the user gives any."""


@dataclass(frozen=True, slots=True)
class DecisionConfig:
    """When an answer is rejected, beside what the calibration says.

    At most one of ``max_std_m`` and ``max_std_px`` (pixels at W_R) is given; None, as for
    ``min_confidence``, leaves the matter to the calibration, or to the fallbacks where there is
    none. Scales outside ``1 ± max_scale_error`` of the prior's are ``implausible-scale``.
    """

    max_std_m: float | None = None
    max_std_px: float | None = None
    rule: Rule = Rule.ALL
    min_confidence: float | None = None
    max_scale_error: float = 0.25


@dataclass(frozen=True, slots=True)
class PriorConfig:
    """How log and frames are joined: clock, pairing, offset, and the longest gap bridged.

    ``dem_path`` None: ground is flat, as far below each frame as the log says.
    """

    time_base: TimeBase = TimeBase.AUTO
    time_offset_s: float = 0.0
    max_gap_s: float = 2.0
    height_above_ground_m: float | None = None
    pair_by: PairBy = PairBy.AUTO
    dem_path: Path | None = None
    dem_datum: DemDatum = DemDatum.AUTO


@dataclass(frozen=True, slots=True)
class GeotagConfig:
    """Everything that shapes the result of one ``uasthn geotag`` run apart from its inputs.

    ``ue`` None is the method that uses most of what the run has, ``merge`` None the larger of two
    uncertainties, ``aggregation`` None the paper's choice for the method.
    """

    estimator: str = "xcorr"
    search_radius_m: float = 200.0
    gsd_m: float | None = None
    device: str = "auto"
    symmetries: int = DEFAULT_SYMMETRIES
    ensemble: bool = False
    ue_iterations: int | None = None
    crops: CropTtaConfig = CropTtaConfig()
    ue: UeMethod | None = None
    merge: Merge | None = None
    aggregation: Aggregation | None = None
    fuse: bool = True
    map_error_m: float = DEFAULT_MAP_ERROR_M
    attitude_error_deg: float = DEFAULT_ATTITUDE_ERROR_DEG
    decision: DecisionConfig = DecisionConfig()


@dataclass(frozen=True, slots=True)
class TrainingDefaults:
    """Length, pace and data of one ``uasthn train`` run.

    A batch is ``windows`` pieces of map with ``canvases`` thermal views each; ``sand_share`` of the
    windows show rendered sand, ``landscape_share`` rendered landscapes.
    """

    steps: int = 6000
    learning_rate: float = 2e-3
    windows: int = 8
    canvases: int = 4
    sand_share: float = 0.18
    landscape_share: float = 0.28
    seed: int = 0
    workers: int = 1
    checkpoint_every: int = 50
    validate_every: int = 500


THERMAL_WIDTH_PX = 96
"""Width of a frame's footprint on the map grid that the default GSD aims at."""

REFINE_WIDTH_PX = 256
"""The same for the refinement near the place that the flight settled on."""

MAX_MAP_ENLARGEMENT = 2.0
"""How much finer than the map's own GSD the default may be."""

ORIGIN_STEP_DEG = 0.05
"""Map grids are centred on multiples of this, so that flights of one area share one grid."""

GSD_STEP = 2 ** (1 / 12)
"""Map grids have powers of this in metres, so that flights of about one height share one grid."""

MAX_TILT_DEG = 30.0
"""Beyond this angle between the optical axis and the vertical a frame is ``too-oblique``."""

MAX_CACHE_BYTES = 2 * 2**30
"""How large the folder of map features on disk may become; the least recently used go first."""

MAX_HASHED_BYTES = 512 * 2**20
"""Larger files, maps as a rule, are never read as a whole, not even to tell one from another."""

MAX_TILE_BYTES = 64 * 2**20
"""How much of the map's features is kept in memory of each grid, unless one frame needs more."""
