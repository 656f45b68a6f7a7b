"""One driver for everybody: what is kept is not computed again, and order does not matter."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from lane_flight import SEARCH_RADIUS_M, lane_poses
from posed_flight import PosedFlight, alone, make_posed_flight, opened

from uasthn_cli.config import CropTtaConfig
from uasthn_cli.outputs.journal import LOCATED, REFINED, Journal
from uasthn_cli.outputs.result_json import encode_located
from uasthn_cli.pipeline import Outcome, Run, drive
from uasthn_cli.pipeline.driver import MemoryJournals
from uasthn_cli.types import FrameResult, Located

QUICK: dict[str, Any] = {"search_radius_m": SEARCH_RADIUS_M, "crops": CropTtaConfig(views=2)}


@pytest.fixture(scope="module")
def lanes(tmp_path_factory: pytest.TempPathFactory) -> PosedFlight:
    return make_posed_flight(tmp_path_factory.mktemp("lanes"), lane_poses(lanes=2))


@pytest.fixture(scope="module")
def straight(lanes: PosedFlight) -> Outcome:
    with opened(lanes, **QUICK) as run:
        return drive(run)


def lines(results: list[FrameResult]) -> list[str]:
    return [encode_located(Located(result, None)) for result in results]


def test_answers_come_in_frame_order_and_everything_was_computed(
    lanes: PosedFlight, straight: Outcome
) -> None:
    assert straight.flight is not None
    assert len(straight.results) == straight.computed_frames == len(lanes.names)
    assert [entry.result.prior.frame.name for entry in straight.located] == lanes.names  # type: ignore[union-attr]


def test_frames_finished_in_any_order_give_the_same_answers(
    lanes: PosedFlight, straight: Outcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    def backwards(step: Callable[..., Iterator[Any]]) -> Callable[..., Iterator[Any]]:
        return lambda *args: iter(list(step(*args))[::-1])

    monkeypatch.setattr(Run, "locate", backwards(Run.locate))
    monkeypatch.setattr(Run, "refine", backwards(Run.refine))
    with opened(lanes, **QUICK) as run:
        outcome = drive(run)
    assert lines(outcome.results) == lines(straight.results)


def test_a_run_that_died_goes_on_from_what_is_kept(
    lanes: PosedFlight, straight: Outcome, tmp_path: Path
) -> None:
    def dying(frames: int) -> Callable[[str, int, int], Any]:
        @contextmanager
        def progress(step: str, total: int, done: int) -> Iterator[Callable[[int], None]]:
            def advance(steps: int) -> None:
                if step == "refining" and steps == frames:
                    raise KeyboardInterrupt

            yield advance

        return progress

    class Journals:
        def __init__(self) -> None:
            self.located = Journal(tmp_path, "print", LOCATED)
            self.refined = Journal(tmp_path, "print", REFINED)

    with opened(lanes, **QUICK) as run:
        with pytest.raises(KeyboardInterrupt):
            drive(run, Journals(), dying(3))
        again = Journals()
        assert (len(again.located.finished), len(again.refined.finished)) == (len(lanes.names), 3)
        outcome = drive(run, again)
    assert outcome.computed_frames == 0
    assert outcome.write_s > 0.0
    assert lines(outcome.results) == lines(straight.results)


def test_progress_is_told_step_by_step(lanes: PosedFlight) -> None:
    told: list[tuple[str, int, int]] = []

    @contextmanager
    def progress(step: str, total: int, done: int) -> Iterator[Callable[[int], None]]:
        yield lambda steps: told.append((step, steps, total))

    count = len(lanes.names)
    with opened(lanes, **QUICK) as run:
        drive(run, MemoryJournals(), progress)
    steps = ("geo-tagging", "refining")
    assert told == [(step, k, count) for step in steps for k in range(1, count + 1)]


def test_without_fusion_every_frame_stands_alone(lanes: PosedFlight) -> None:
    with opened(lanes, fuse=False, **QUICK) as run:
        outcome = drive(run)
        assert outcome.flight is None
        assert lines(outcome.results) == lines(alone(run))
