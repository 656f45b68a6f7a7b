"""The whole flight settles every frame: what it knows better, and what it must leave alone."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from known_model import known_encoders
from lane_flight import SEARCH_RADIUS_M, Fused, errors_m, fused, lane_poses
from posed_flight import (
    HFOV_DEG,
    TAKE_OFF_AMSL_M,
    LogFaults,
    PosedFlight,
    make_posed_flight,
    opened,
    see,
)
from scipy.ndimage import gaussian_filter
from small_flight import MAP_GSD_M, ground_texture

from uasthn_cli.config import CropTtaConfig
from uasthn_cli.fusion.constants import FlightConstants
from uasthn_cli.matching.ncc import NccEstimator
from uasthn_cli.matching.xcorr import XcorrEstimator
from uasthn_cli.outputs.result_json import (
    decode_located,
    decode_refined_frame,
    encode_located,
    encode_refined_frame,
)
from uasthn_cli.pipeline import Run, drive
from uasthn_cli.seam import Estimate
from uasthn_cli.types import (
    Attitude,
    Fix,
    FloatArray,
    FrameFailure,
    FrameResult,
    Located,
    MapFeatures,
    Ortho,
    Reason,
    RefinedFrame,
    Source,
)

QUICK: dict[str, Any] = {"search_radius_m": SEARCH_RADIUS_M, "crops": CropTtaConfig(views=2)}
NOISE_GREYS = 25.0
BLANK, TRUNCATED, ASTRAY = 5, 9, 18
"""Frames of the spoilt flight that show nothing, cannot be read, and show another place."""


@pytest.fixture(scope="module")
def lanes(tmp_path_factory: pytest.TempPathFactory) -> PosedFlight:
    return make_posed_flight(tmp_path_factory.mktemp("lanes"), lane_poses(), faults=LogFaults())


@pytest.fixture(scope="module")
def clean(lanes: PosedFlight) -> Fused:
    with opened(lanes, **QUICK) as run:
        return fused(run)


@pytest.fixture(scope="module")
def spoilt(tmp_path_factory: pytest.TempPathFactory) -> tuple[PosedFlight, Fused]:
    """Return a flight of frames so noisy that many alone go astray; three are bad besides."""
    folder = tmp_path_factory.mktemp("spoilt")
    flight = make_posed_flight(folder, lane_poses(drift_m=0.5), faults=LogFaults())
    elsewhere = flight.poses[ASTRAY]
    elsewhere = replace(elsewhere, east_m=elsewhere.east_m - 25.0, south_m=elsewhere.south_m + 20.0)
    random = np.random.default_rng(6)
    paths = [str(flight.frames / name) for name in flight.names]
    pictures = [np.asarray(cv2.imread(path, cv2.IMREAD_GRAYSCALE), np.uint8) for path in paths]
    pictures[ASTRAY] = see(ground_texture(8), elsewhere)
    for name, picture in zip(flight.names, pictures, strict=True):
        noise = gaussian_filter(random.standard_normal(picture.shape), 3.0)
        noisy = 128.0 - 0.25 * (picture - 128.0) + NOISE_GREYS * noise / noise.std()
        cv2.imwrite(str(flight.frames / name), np.clip(noisy, 0, 255).astype(np.uint8))
    cv2.imwrite(str(flight.frames / flight.names[BLANK]), np.full_like(pictures[0], 77))
    path = flight.frames / flight.names[TRUNCATED]
    path.write_bytes(path.read_bytes()[:900])
    with opened(flight, **QUICK) as run:
        return flight, fused(run)


def test_every_frame_is_answered_by_the_flight_in_frame_order(
    lanes: PosedFlight, clean: Fused
) -> None:
    assert [fix.prior.frame.name for fix in clean.fixes] == lanes.names
    for fix, single in zip(clean.fixes, clean.singles, strict=True):
        assert (fix.source, fix.accepted, fix.reason) == (Source.FUSED, True, None)
        assert fix.single is single
        assert single.source is Source.FIX
        assert single.single is None
        assert fix.uncertainty_m == single.uncertainty_m
        assert fix.trust.agreement_m < 2.0
        assert fix.trust.support > 0.9
        assert math.isnan(single.trust.support)


def test_convention_fused_camera_centre_and_corners_are_right_to_a_map_pixel(
    lanes: PosedFlight, clean: Fused
) -> None:
    assert errors_m(clean.fixes, lanes).max() < MAP_GSD_M
    for fix, pose in zip(clean.fixes, lanes.poses, strict=True):
        assert abs(math.remainder(fix.yaw_deg - pose.yaw_deg, 360.0)) < 0.1
        assert fix.offset_m == pytest.approx(math.hypot(*pose.prior_error_m), abs=MAP_GSD_M)


def test_convention_offsets_are_those_of_the_log(lanes: PosedFlight, clean: Fused) -> None:
    """The log says east and south of the truth by the pose's error: the truth is the other way."""
    errors = np.array([pose.prior_error_m for pose in lanes.poses]) * (-1.0, 1.0)
    assert np.abs(clean.flight.offsets_m - errors).max() < 2.0


def test_a_correct_log_has_no_constants(clean: Fused) -> None:
    constants = clean.flight.constants
    assert (constants.yaw_to_apply_rad, constants.clock_to_apply_s) == (0.0, 0.0)
    assert constants.scale_to_apply == 1.0


def test_the_flight_is_at_least_as_good_as_its_frames(
    spoilt: tuple[PosedFlight, Fused],
) -> None:
    flight, outcome = spoilt
    own, of_flight = [], []
    for result, pose in zip(outcome.results, flight.poses, strict=True):
        if isinstance(result, Fix) and result.single is not None:
            alone = replace(flight, poses=(pose,))
            own.append(errors_m([result.single], alone)[0, 1])
            of_flight.append(errors_m([result], alone)[0, 1])
    assert len(own) == len(flight.poses) - 2
    assert sum(error_m > 25.0 for error_m in own) > 5
    assert max(of_flight) < 3.0
    assert np.median(of_flight) < np.median(own)


def test_a_frame_that_shows_nothing_has_a_place_but_is_not_accepted(
    spoilt: tuple[PosedFlight, Fused],
) -> None:
    flight, outcome = spoilt
    fix = outcome.results[BLANK]
    assert isinstance(fix, Fix)
    assert (fix.source, fix.accepted, fix.reason) == (Source.FUSED, False, Reason.TEXTURELESS)
    assert fix.single is None
    assert math.isnan(fix.uncertainty_m)
    assert math.isnan(fix.trust.agreement_m)
    error_m = errors_m([fix], replace(flight, poses=(flight.poses[BLANK],)))[0, 0]
    assert error_m < 6.0
    neighbour = outcome.results[BLANK + 1]
    assert isinstance(neighbour, Fix)
    assert neighbour.reason is Reason.UNSUPPORTED, "in such noise no frame is sure alone"
    assert re.match(r"support 0\.\d+, more than 0\.60 needed: alone it", neighbour.detail)
    assert f"{flight.names[ASTRAY]} by" in neighbour.detail
    assert "says nothing" in neighbour.detail  # the frame that shows nothing
    assert fix.trust.ce90_m > neighbour.trust.ce90_m
    assert error_m < fix.trust.ce90_m


def test_a_frame_that_cannot_be_read_stays_so(spoilt: tuple[PosedFlight, Fused]) -> None:
    _, outcome = spoilt
    failure = outcome.results[TRUNCATED]
    assert isinstance(failure, FrameFailure)
    assert failure.reason is Reason.UNREADABLE
    assert failure is outcome.located[TRUNCATED].result


def test_a_frame_that_is_sure_of_another_place_is_overruled(
    spoilt: tuple[PosedFlight, Fused],
) -> None:
    flight, outcome = spoilt
    fix = outcome.results[ASTRAY]
    assert isinstance(fix, Fix)
    assert fix.single is not None
    alone = replace(flight, poses=(flight.poses[ASTRAY],))
    assert errors_m([fix.single], alone)[0, 1] > 25.0
    assert errors_m([fix], alone)[0, 1] < 6.0
    assert fix.trust.agreement_m > 20.0
    assert fix.trust.support < 1.0


def biased(
    folder: Path, faults: LogFaults, mount_yaw_deg: float = 0.0
) -> tuple[PosedFlight, Fused]:
    """Return a flight with a wrong log, seen by the learned estimator with known encoders."""
    flight = make_posed_flight(folder, lane_poses(), mount_yaw_deg, faults)
    estimator = XcorrEstimator(known_encoders(), symmetries=1)
    with opened(flight, estimator, gsd_m=2.0, **QUICK) as run:
        assert run.describe()["refine_map_gsd_m"] == pytest.approx(MAP_GSD_M, rel=1e-3)
        return flight, fused(run)


@pytest.mark.parametrize(
    ("yaw_deg", "height_factor", "mount_yaw_deg"), [(3.0, 1.04, 0.0), (-4.0, 0.96, 90.0)]
)
def test_convention_a_wrong_heading_and_height_are_found_and_corrected(
    tmp_path: Path, yaw_deg: float, height_factor: float, mount_yaw_deg: float
) -> None:
    faults = LogFaults(yaw_deg=yaw_deg, height_factor=height_factor)
    flight, outcome = biased(tmp_path, faults, mount_yaw_deg)
    constants = outcome.flight.constants
    assert math.degrees(constants.yaw_to_apply_rad) == pytest.approx(yaw_deg, abs=0.3)
    assert constants.scale_to_apply == pytest.approx(height_factor, abs=0.01)
    own, of_flight = errors_m(outcome.singles, flight), errors_m(outcome.fixes, flight)
    assert own[:, 2].mean() > 3.0
    assert of_flight.max() < MAP_GSD_M
    for fix, pose in zip(outcome.fixes, flight.poses, strict=True):
        top_deg = pose.yaw_deg + mount_yaw_deg
        assert abs(math.remainder(fix.yaw_deg - top_deg, 360.0)) < 0.3
        assert fix.height_above_ground_m == pytest.approx(pose.height_m, rel=0.01)
        logged_m = pose.height_m / height_factor + TAKE_OFF_AMSL_M
        assert fix.alt_amsl_m == pytest.approx(logged_m, abs=0.01)  # not moved with the height


def test_more_than_a_log_gets_wrong_is_left_alone(tmp_path: Path) -> None:
    """What fits best at the edge of what is tried may fit better beyond."""
    _, outcome = biased(tmp_path, LogFaults(yaw_deg=6.0))
    assert outcome.flight.constants.yaw_rad is None
    assert outcome.flight.constants.log_scale is None


def test_the_second_look_is_finer_than_the_search(tmp_path: Path) -> None:
    flight, outcome = biased(tmp_path, LogFaults())
    constants = outcome.flight.constants
    assert (constants.yaw_to_apply_rad, constants.scale_to_apply) == (0.0, 1.0)
    own, of_flight = errors_m(outcome.singles, flight), errors_m(outcome.fixes, flight)
    assert of_flight[:, 1].mean() < own[:, 1].mean()


@pytest.mark.parametrize("clock_s", [1.2, -0.8])
def test_convention_a_wrong_clock_is_found(tmp_path: Path, clock_s: float) -> None:
    """Frames stamped too early by ``clock_s``: that is what is to be added to their times."""
    flight = make_posed_flight(tmp_path, lane_poses(), faults=LogFaults(clock_s=clock_s))
    with opened(flight, **QUICK) as run:
        outcome = fused(run)
    clock = outcome.flight.constants.clock_s
    assert clock is not None
    assert clock.is_significant
    assert clock.value == pytest.approx(clock_s, abs=max(0.05, 3 * clock.error))
    assert errors_m(outcome.fixes, flight).max() < MAP_GSD_M


def lines(results: list[FrameResult]) -> list[str]:
    return [encode_located(Located(result, None)) for result in results]


def test_two_runs_give_equal_answers(lanes: PosedFlight, clean: Fused) -> None:
    with opened(lanes, **QUICK) as run:
        assert lines(drive(run).results) == lines(clean.results)


def test_what_is_taken_over_from_journals_gives_the_same_answers(
    lanes: PosedFlight, clean: Fused
) -> None:
    located = [decode_located(encode_located(entry)) for entry in clean.located]
    names = lanes.names
    with opened(lanes, **QUICK) as run:
        fused_flight = run.fuse_flight(located)
        assert fused_flight is not None
        before = dict(list(_refined_by_name(run, clean))[:11])
        refined = {
            name: decode_refined_frame(encode_refined_frame(entry))
            for name, entry in before.items()
        }
        refined |= {entry.frame.name: entry for entry in run.refine(fused_flight, skip=refined)}
        assert list(refined) == names
        poses = run.settle_poses(fused_flight, refined)
        results = run.place_frames(located, fused_flight, refined, poses)
        assert lines(results) == lines(clean.results)


def _refined_by_name(run: Run, outcome: Fused) -> list[tuple[str, RefinedFrame]]:
    return [(entry.frame.name, entry) for entry in run.refine(outcome.flight)]


def test_without_fusion_nothing_finer_is_opened(lanes: PosedFlight, clean: Fused) -> None:
    with opened(lanes, fuse=False, gsd_m=2.0, **QUICK) as run:
        described = run.describe()
    assert described["refine_map_gsd_m"] == described["map_gsd_m"] == 2.0
    with opened(lanes, fuse=False, **QUICK) as run:
        assert lines(drive(run).results) == lines([*clean.singles])


class Mute(NccEstimator):
    """Answers as NCC does, but keeps its scores to itself."""

    name = "mute"

    def estimate(
        self,
        features: MapFeatures,
        thermal: Ortho,
        views_px: FloatArray,
        origin_px: FloatArray,
        evidence: FloatArray | None = None,
    ) -> Estimate:
        return replace(
            super().estimate(features, thermal, views_px, origin_px, evidence), scores=None
        )


def test_an_estimator_without_scores_has_no_flight(flight: PosedFlight) -> None:
    with opened(flight, Mute()) as run:
        located = list(run.locate())
        assert run.fuse_flight(located) is None
    for entry in located:
        assert isinstance(entry.result, Fix)
        assert entry.likelihood is None
        assert entry.result.accepted
        assert math.isnan(entry.result.trust.entropy_nats)
        assert math.isfinite(entry.result.trust.ce90_m)


def test_a_single_frame_is_a_flight(tmp_path: Path) -> None:
    flight = make_posed_flight(tmp_path, lane_poses()[:1])
    with opened(flight, **QUICK) as run:
        outcome = fused(run)
    assert errors_m(outcome.fixes, flight).max() < MAP_GSD_M
    assert outcome.flight.constants == FlightConstants()


def test_a_frame_deleted_before_the_refinement_keeps_its_own_answer(tmp_path: Path) -> None:
    flight = make_posed_flight(tmp_path, lane_poses()[:4])
    with opened(flight, **QUICK) as run:
        located = list(run.locate())
        fused_flight = run.fuse_flight(located)
        assert fused_flight is not None
        (flight.frames / flight.names[2]).unlink()
        refined = {entry.frame.name: entry for entry in run.refine(fused_flight)}
        gone = fused_flight.frames[2].prior.frame
        assert refined[flight.names[2]] == RefinedFrame(gone, None, None)
        results = run.place_frames(located, fused_flight, refined)
    assert results[2] is located[2].result
    assert [result is entry.result for result, entry in zip(results, located, strict=True)] == [
        *(False, False, True, False)
    ]


def test_a_frame_that_a_corrected_clock_tips_over_keeps_its_own_answer(
    lanes: PosedFlight, clean: Fused
) -> None:
    """In a steep turn a second makes the difference between the ground and the horizon."""
    tipped = list(clean.flight.corrected_priors)
    over = math.radians(91.0 - HFOV_DEG / 2)
    tipped[3] = replace(tipped[3], attitude=Attitude(over, 0.0, 0.0))
    fused_flight = replace(clean.flight, corrected_priors=tuple(tipped))
    with opened(lanes, **QUICK) as run:
        refined = {entry.frame.name: entry for entry in run.refine(fused_flight)}
        assert refined[lanes.names[3]].likelihood is None
        results = run.place_frames(clean.located, fused_flight, refined)
    assert results[3] is clean.located[3].result
    assert sum(isinstance(r, Fix) and r.source is Source.FUSED for r in results) == len(results) - 1
