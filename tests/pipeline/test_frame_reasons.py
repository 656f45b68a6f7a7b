"""A bad frame becomes a row with its reason and never stops the run."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from posed_flight import (
    POSES,
    SIZE_PX,
    Pose,
    PosedFlight,
    alone,
    make_posed_flight,
    opened,
)
from small_flight import MAP_GSD_M

from uasthn_cli.config import CropTtaConfig, DecisionConfig
from uasthn_cli.matching.ncc import NccEstimator
from uasthn_cli.seam import Estimate
from uasthn_cli.types import (
    Fix,
    FloatArray,
    FrameFailure,
    FrameResult,
    MapFeatures,
    MapWindow,
    Ortho,
    Reason,
)

GOOD = POSES[0]
BAD: dict[str, Pose] = {
    "good": GOOD,
    "truncated": GOOD,
    "text": GOOD,
    "oblique": Pose(180.0, 150.0, pitch_deg=5.0, logged_pitch_deg=38.0),
    "textureless": GOOD,
    "off-map": Pose(190.0, 160.0, prior_error_m=(2500.0, 0.0)),
    "map's edge": Pose(60.0, 160.0, prior_error_m=(-120.0, 0.0)),
    "on the ground": Pose(190.0, 160.0, logged_height_m=0.4),
    "very low": Pose(190.0, 160.0, logged_height_m=5.0),
    "good again": POSES[1],
}
OUTSIDE_LOG = "frame_1763900000000.png"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, FrameResult]:
    flight = make_posed_flight(tmp_path_factory.mktemp("bad"), tuple(BAD.values()))
    spoil(flight)
    names = dict(zip(flight.names, BAD, strict=True)) | {OUTSIDE_LOG: "outside-log"}
    with opened(flight) as run:
        return {names[result_name(result)]: result for result in alone(run)}


def spoil(flight: PosedFlight) -> None:
    """Damage the frames that are to be bad, and add one from long after the flight."""
    path = {label: flight.frames / name for label, name in zip(BAD, flight.names, strict=True)}
    (flight.frames / OUTSIDE_LOG).write_bytes(path["good"].read_bytes())
    path["truncated"].write_bytes(path["good"].read_bytes()[:900])
    path["text"].write_text("not a picture")
    cv2.imwrite(str(path["textureless"]), np.full(SIZE_PX[::-1], 77, np.uint8))


def result_name(result: FrameResult) -> str:
    return result.prior.frame.name if isinstance(result, Fix) else result.frame.name


def test_every_frame_has_a_row(results: dict[str, FrameResult]) -> None:
    assert list(results) == [*BAD, "outside-log"]


@pytest.mark.parametrize(
    ("label", "reason", "detail"),
    [
        ("truncated", Reason.UNREADABLE, "truncated"),
        ("text", Reason.UNREADABLE, "not a PNG"),
        ("oblique", Reason.TOO_OBLIQUE, "38°"),
        ("textureless", Reason.TEXTURELESS, "same value"),
        ("off-map", Reason.OFF_MAP, "no map data"),
        ("on the ground", Reason.NO_PRIOR, "on the ground"),
        ("very low", Reason.NO_PRIOR, "footprint"),
        ("outside-log", Reason.OUTSIDE_LOG, ""),
    ],
)
def test_a_frame_without_an_estimate_says_why(
    label: str, reason: Reason, detail: str, results: dict[str, FrameResult]
) -> None:
    failure = results[label]
    assert isinstance(failure, FrameFailure)
    assert failure.reason is reason
    assert detail in failure.detail
    assert "\n" not in failure.detail
    assert failure.time_utc_s is not None
    assert (failure.prior is None) == (label in {"outside-log", "on the ground"})


def test_an_estimate_that_hangs_over_the_maps_edge_is_kept_but_rejected(
    results: dict[str, FrameResult],
) -> None:
    fix = results["map's edge"]
    assert isinstance(fix, Fix)
    assert (fix.accepted, fix.reason) == (False, Reason.OFF_MAP)
    assert "of the footprint found lie on the map, 0.50 needed" in fix.detail
    assert fix.offset_m == pytest.approx(0.0, abs=MAP_GSD_M)  # no place counts: the prior's


@pytest.mark.parametrize("label", ["good", "good again"])
def test_good_frames_before_and_after_are_accepted(
    label: str, results: dict[str, FrameResult]
) -> None:
    fix = results[label]
    assert isinstance(fix, Fix)
    assert fix.accepted


def test_frames_of_another_size_are_placed_as_well(tmp_path: Path) -> None:
    flight = make_posed_flight(tmp_path, POSES[:2])
    path = flight.frames / flight.names[1]
    frame = np.asarray(cv2.imread(str(path)), np.uint8)
    half = cv2.resize(frame, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(path), half)
    with opened(flight) as run:
        whole, small = alone(run)
    assert isinstance(whole, Fix)
    assert isinstance(small, Fix)
    assert small.accepted
    assert small.gsd_m == pytest.approx(2 * whole.gsd_m, rel=0.01)


class ScriptedEstimator(NccEstimator):
    """Answers what it is told: the views' corners, moved by ``move``."""

    name = "scripted"

    def __init__(self, move: FloatArray, confidence: float = 1.0) -> None:
        super().__init__()
        self.move, self.confidence = move, confidence

    def encode_map(self, window: MapWindow) -> NDArray[np.float32]:
        return np.zeros((1, *window.valid.shape), np.float32)

    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        return Estimate(views_px + origin_px + self.move, self.confidence)


def judged(
    flight: PosedFlight, move: FloatArray, confidence: float = 1.0, **settings: object
) -> FrameResult:
    estimator = ScriptedEstimator(move, confidence)
    with opened(flight, estimator, **settings) as run:
        (entry,) = run.locate(skip=flight.names[1:])
    return entry.result


def test_an_estimator_that_repeats_the_prior_gives_the_prior(flight: PosedFlight) -> None:
    fix = judged(flight, np.zeros(2))
    assert isinstance(fix, Fix)
    assert fix.accepted
    assert fix.offset_m == pytest.approx(0.0, abs=1e-3)
    assert (fix.lat_deg, fix.lon_deg) == pytest.approx(
        (fix.prior.lat_deg, fix.prior.lon_deg), abs=1e-8
    )


def test_convention_a_shift_in_the_window_is_a_shift_on_the_ground(flight: PosedFlight) -> None:
    still = judged(flight, np.zeros(2), gsd_m=0.5)
    moved = judged(flight, np.array([12.0, -6.0]), gsd_m=0.5)
    assert isinstance(still, Fix)
    assert isinstance(moved, Fix)
    assert moved.offset_m == pytest.approx(math.hypot(6.0, 3.0), rel=1e-3)
    assert moved.lon_deg > still.lon_deg
    assert moved.lat_deg > still.lat_deg


def test_an_answer_that_is_not_on_earth_is_rejected(flight: PosedFlight) -> None:
    fix = judged(flight, np.array([1e12, 0.0]))
    assert isinstance(fix, Fix)
    assert not fix.accepted


def test_views_that_disagree_make_a_frame_uncertain(flight: PosedFlight) -> None:
    apart = np.random.default_rng(0).normal(0.0, 30.0, (5, 1, 2))
    fix = judged(flight, apart)
    assert isinstance(fix, Fix)
    assert (fix.accepted, fix.reason) == (False, Reason.UNCERTAIN)
    assert fix.uncertainty_m > 10.0


def test_a_tolerant_threshold_accepts_them(flight: PosedFlight) -> None:
    apart = np.random.default_rng(0).normal(0.0, 3.0, (5, 1, 2))
    strict = judged(flight, apart, decision=DecisionConfig(max_std_m=0.5))
    lenient = judged(flight, apart, decision=DecisionConfig(max_std_m=9.0))
    assert isinstance(strict, Fix)
    assert isinstance(lenient, Fix)
    assert (strict.accepted, lenient.accepted) == (False, True)
    assert strict.uncertainty_m == lenient.uncertainty_m


def test_little_belief_makes_a_frame_ambiguous(flight: PosedFlight) -> None:
    fix = judged(flight, np.zeros(2), confidence=0.2)
    assert isinstance(fix, Fix)
    assert (fix.accepted, fix.reason) == (False, Reason.AMBIGUOUS)
    assert fix.trust.confidence == 0.2


def test_a_footprint_that_grows_is_implausible(flight: PosedFlight) -> None:
    grown = 50.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]])
    fix = judged(flight, grown, crops=CropTtaConfig(views=1))
    assert isinstance(fix, Fix)
    assert (fix.accepted, fix.reason) == (False, Reason.IMPLAUSIBLE_SCALE)


def test_corners_on_a_line_are_a_degenerate_homography(flight: PosedFlight) -> None:
    collapsed = np.array([[0.0, 0.0], [0.0, 0.0], [90.0, -90.0], [0.0, 0.0]])
    single = CropTtaConfig(views=1)
    with opened(flight, OnALine(collapsed), crops=single) as run:
        result, *others = alone(run)
    assert isinstance(result, FrameFailure)
    assert result.reason is Reason.DEGENERATE_HOMOGRAPHY
    assert len(others) == len(flight.names) - 1


class OnALine(ScriptedEstimator):
    """Sees the four corners on one line."""

    name = "on-a-line"

    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        line = np.array([[0.0, 0.0], [10.0, 10.0], [20.0, 20.0], [30.0, 30.0]])
        return Estimate(line + 0 * views_px + origin_px, 1.0)
