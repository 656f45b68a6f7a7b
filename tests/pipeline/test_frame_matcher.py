"""A frame matched on two map grids: what the second says lies where the first's shifts lie."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace

import pytest
from posed_flight import HFOV_DEG, SEARCH_RADIUS_M, PosedFlight, opened

from uasthn_cli.config import CropTtaConfig
from uasthn_cli.geometry.corners import DegenerateHomographyError
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.ingest.frames import read_frame
from uasthn_cli.mapping.reader import MapReader
from uasthn_cli.mapping.tiles import FeatureTiles
from uasthn_cli.matching.ncc import NccEstimator
from uasthn_cli.pipeline.frame_matcher import FrameMatcher, UnmatchableFrameError
from uasthn_cli.pipeline.timing import StageTimer
from uasthn_cli.seam import Estimate
from uasthn_cli.types import Prior

WHOLE_FRAME = CropTtaConfig(views=1)
SECOND_GSD_M = 0.6


@pytest.fixture(scope="module")
def priors(flight: PosedFlight) -> list[Prior]:
    with opened(flight) as run:
        return [entry for entry in run.priors.results if isinstance(entry, Prior)]


@dataclass(frozen=True)
class Parts:
    """What a matcher is made of."""

    local: LocalFrame
    reader: MapReader
    estimator: NccEstimator

    def matcher(
        self, *, second: FrameMatcher | None = None, members: tuple[FrameMatcher, ...] = ()
    ) -> FrameMatcher:
        tiles = FeatureTiles(self.reader.read, self.estimator.encode_map, stride_px=1, halo_px=0)
        return FrameMatcher(
            CameraSpec(hfov_deg=HFOV_DEG),
            self.reader.grid,
            tiles,
            self.estimator,
            self.local,
            StageTimer(),
            second=second,
            members=members,
        )


@pytest.fixture(scope="module")
def scales(flight: PosedFlight, priors: list[Prior]) -> Iterator[tuple[Parts, Parts]]:
    local = LocalFrame(priors[0].lat_deg, priors[0].lon_deg)
    with ExitStack() as stack:
        first, second = (
            Parts(local, stack.enter_context(MapReader(flight.map, local, gsd_m)), NccEstimator())
            for gsd_m in (1.0, SECOND_GSD_M)
        )
        yield first, second


def test_convention_evidence_of_another_scale_peaks_at_the_same_place(
    scales: tuple[Parts, Parts], priors: list[Prior]
) -> None:
    first, second = (parts.matcher() for parts in scales)
    for prior in priors:
        match = first.match(prior, WHOLE_FRAME, SEARCH_RADIUS_M)
        own = match.estimate.scores
        evidence = second.evidence(
            prior, read_frame(prior.frame.path), SEARCH_RADIUS_M, match.scene
        )
        assert own is not None
        assert evidence is not None
        assert evidence.shape == own.shape == match.scene.shifts
        peaks = [divmod(int(field.argmax()), own.shape[1]) for field in (own, evidence)]
        assert peaks[1] == pytest.approx(peaks[0], abs=1)


def test_two_scales_are_surer_than_one(scales: tuple[Parts, Parts], priors: list[Prior]) -> None:
    first, second = (parts.matcher() for parts in scales)
    both = scales[0].matcher(second=second)
    alone, together = (
        matcher.match(priors[0], WHOLE_FRAME, SEARCH_RADIUS_M).estimate for matcher in (first, both)
    )
    assert together.confidence > alone.confidence
    assert together.corners_px == pytest.approx(alone.corners_px, abs=1.0)


def test_a_second_scale_that_sees_nothing_says_nothing(
    scales: tuple[Parts, Parts], priors: list[Prior], flight: PosedFlight
) -> None:
    first, second = (parts.matcher() for parts in scales)
    scene = first.scene(priors[0], SEARCH_RADIUS_M)
    far = Prior(
        frame=priors[0].frame,
        time_utc_s=0.0,
        lat_deg=priors[0].lat_deg + 0.1,
        lon_deg=priors[0].lon_deg,
        height_above_ground_m=priors[0].height_above_ground_m,
        attitude=priors[0].attitude,
        height_source="test",
    )
    assert second.evidence(far, read_frame(far.frame.path), SEARCH_RADIUS_M, scene) is None


def test_members_say_where_they_find_the_whole_frame(
    scales: tuple[Parts, Parts], priors: list[Prior]
) -> None:
    first = scales[0].matcher()
    three = scales[0].matcher(members=(first, first))
    match = three.match(priors[0], CropTtaConfig(), SEARCH_RADIUS_M)
    assert match.members_px.shape == (2, 4, 2)
    for member_px in match.members_px:
        assert member_px == pytest.approx(match.estimate.corners_px[0])
    assert len(match.estimate.corners_px) == CropTtaConfig().views
    assert first.match(priors[0], WHOLE_FRAME, SEARCH_RADIUS_M).members_px.shape == (0, 4, 2)
    assert (first.members, three.members) == (1, 3)


class Lost(NccEstimator):
    """A network whose corners lie on a line."""

    def estimate(self, *_: object, **__: object) -> Estimate:
        raise DegenerateHomographyError("three corners lie on one line")


def test_a_member_that_finds_nothing_answers_with_the_log(
    scales: tuple[Parts, Parts], priors: list[Prior], caplog: pytest.LogCaptureFixture
) -> None:
    lost = replace(scales[0], estimator=Lost()).matcher()
    caplog.set_level("DEBUG")
    match = scales[0].matcher(members=(lost,)).match(priors[0], WHOLE_FRAME, SEARCH_RADIUS_M)
    assert match.members_px[0] == pytest.approx(match.views_px[0] + match.scene.origin_px)
    assert "answers with the log's place: three corners lie on one line" in caplog.text
    with pytest.raises(UnmatchableFrameError, match="three corners lie on one line"):
        lost.match(priors[0], WHOLE_FRAME, SEARCH_RADIUS_M)
