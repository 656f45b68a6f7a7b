"""A frame looked at on two map grids: what the second says lies where the first's shifts lie."""

from collections.abc import Iterator
from contextlib import ExitStack
from copy import copy

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
from uasthn_cli.pipeline.look import Looker, LookError
from uasthn_cli.pipeline.timing import StageTimer
from uasthn_cli.seam import Estimate
from uasthn_cli.types import Prior

WHOLE_FRAME = CropTtaConfig(views=1)
SECOND_GSD_M = 0.6


@pytest.fixture(scope="module")
def priors(flight: PosedFlight) -> list[Prior]:
    with opened(flight) as run:
        return [entry for entry in run.priors.results if isinstance(entry, Prior)]


@pytest.fixture(scope="module")
def lookers(flight: PosedFlight, priors: list[Prior]) -> Iterator[tuple[Looker, Looker]]:
    local = LocalFrame(priors[0].lat_deg, priors[0].lon_deg)
    camera, estimator = CameraSpec(hfov_deg=HFOV_DEG), NccEstimator()
    with ExitStack() as stack:
        pair = []
        for gsd_m in (1.0, SECOND_GSD_M):
            reader = stack.enter_context(MapReader(flight.map, local, gsd_m))
            tiles = FeatureTiles(reader.read, estimator.encode_map, stride_px=1, halo_px=0)
            looker = Looker(camera, reader.grid, tiles, estimator, local, StageTimer())
            pair.append(looker)
        yield pair[0], pair[1]


def test_convention_evidence_of_another_scale_peaks_at_the_same_place(
    lookers: tuple[Looker, Looker], priors: list[Prior]
) -> None:
    first, second = lookers
    for prior in priors:
        look = first.look(prior, WHOLE_FRAME, SEARCH_RADIUS_M)
        own = look.estimate.scores
        evidence = second.evidence(prior, read_frame(prior.frame.path), SEARCH_RADIUS_M, look.scene)
        assert own is not None
        assert evidence is not None
        assert evidence.shape == own.shape == look.scene.shifts
        peaks = [divmod(int(field.argmax()), own.shape[1]) for field in (own, evidence)]
        assert peaks[1] == pytest.approx(peaks[0], abs=1)


def test_two_scales_are_surer_than_one(lookers: tuple[Looker, Looker], priors: list[Prior]) -> None:
    first, second = lookers
    both = first.beside(second)
    alone, together = (
        looker.look(priors[0], WHOLE_FRAME, SEARCH_RADIUS_M).estimate for looker in (first, both)
    )
    assert together.confidence > alone.confidence
    assert together.corners_px == pytest.approx(alone.corners_px, abs=1.0)
    assert first.beside(None).look(
        priors[0], WHOLE_FRAME, SEARCH_RADIUS_M
    ).estimate.confidence == pytest.approx(alone.confidence)


def test_a_second_scale_that_sees_nothing_says_nothing(
    lookers: tuple[Looker, Looker], priors: list[Prior], flight: PosedFlight
) -> None:
    first, second = lookers
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
    lookers: tuple[Looker, Looker], priors: list[Prior]
) -> None:
    first = lookers[0]
    look = first.with_members([first, first]).look(priors[0], CropTtaConfig(), SEARCH_RADIUS_M)
    assert look.members_px.shape == (2, 4, 2)
    for member_px in look.members_px:
        assert member_px == pytest.approx(look.estimate.corners_px[0])
    assert len(look.estimate.corners_px) == CropTtaConfig().views
    assert first.look(priors[0], WHOLE_FRAME, SEARCH_RADIUS_M).members_px.shape == (0, 4, 2)
    assert (first.members, first.with_members([first]).members) == (1, 2)


class Lost(NccEstimator):
    """A network whose corners lie on a line."""

    def estimate(self, *_: object, **__: object) -> Estimate:
        raise DegenerateHomographyError("three corners lie on one line")


def test_a_member_that_finds_nothing_answers_with_the_log(
    lookers: tuple[Looker, Looker], priors: list[Prior], caplog: pytest.LogCaptureFixture
) -> None:
    first, _ = lookers
    lost = copy(first)
    lost.estimator = Lost()
    caplog.set_level("DEBUG")
    look = first.with_members([lost]).look(priors[0], WHOLE_FRAME, SEARCH_RADIUS_M)
    assert look.members_px[0] == pytest.approx(look.views_px[0] + look.scene.origin_px)
    assert "answers with the log's place: three corners lie on one line" in caplog.text
    with pytest.raises(LookError, match="three corners lie on one line"):
        lost.look(priors[0], WHOLE_FRAME, SEARCH_RADIUS_M)
