"""A diagnosis names what frames fit under only where that is clear."""

import math
from collections.abc import Callable
from typing import cast

import pytest

from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.pipeline.diagnosis import Diagnosis, diagnose, line_of
from uasthn_cli.pipeline.trials import Assumption, Trials, tried_and_control


class ScoredTrials:
    """Stands in for trials on frames: scores by a formula."""

    def __init__(self, nats: Callable[[Assumption], float], frames: int = 12) -> None:
        self._nats, self.frames = nats, frames
        self.scores: dict[Assumption, float] = {}

    def score(self, assumption: Assumption) -> float:
        return self.scores.setdefault(assumption, self._nats(assumption))

    def best(self, assumptions: list[Assumption]) -> Assumption:
        return max(assumptions, key=self.score)


def fit_around(truth: Assumption, nats: float = 4.0) -> Callable[[Assumption], float]:
    def score(tried: Assumption) -> float:
        turn_deg = abs((tried.turn_deg - truth.turn_deg + 180.0) % 360.0 - 180.0)
        miss = (turn_deg / 10.0) ** 2 + (math.log(tried.scale / truth.scale) / 0.12) ** 2
        miss += ((tried.added_s - truth.added_s) / 5.0) ** 2
        return nats * math.exp(-0.5 * miss) if tried.mirrored == truth.mirrored else 0.0

    return score


def diagnosed(nats: Callable[[Assumption], float], frames: int = 12) -> Diagnosis | None:
    return diagnose(cast(Trials, ScoredTrials(nats, frames)))


@pytest.mark.parametrize(
    ("truth", "says"),
    [
        (Assumption(turn_deg=180.0), "try --mount-yaw 180"),
        (Assumption(turn_deg=330.0), "try --mount-yaw -30"),
        (Assumption(mirrored=True), "mirrored left to right:"),
        (Assumption(scale=2.0), "2.00 of the stated scale: try --hfov 79.3"),
        (Assumption(added_s=-13.0), "try --time-offset -12.5"),
    ],
)
def test_what_frames_fit_under_is_named_with_its_option(truth: Assumption, says: str) -> None:
    found = diagnosed(fit_around(truth))
    assert found is not None
    assert says in line_of(found, CameraSpec(hfov_deg=45.0), 0.5)


@pytest.mark.parametrize(
    "nats",
    [
        lambda _: 0.3,
        fit_around(Assumption(turn_deg=90.0), nats=1.2),
    ],
    ids=["chance", "weak"],
)
def test_nothing_is_named_that_is_not_clear(nats: Callable[[Assumption], float]) -> None:
    found = diagnosed(nats)
    assert found is not None
    assert found.fits is None
    assert "is this the right map?" in line_of(found, CameraSpec(hfov_deg=45.0), 0.0)


@pytest.mark.parametrize("scale", [1.0, 1.07])
def test_frames_that_fit_as_stated_do_not_question_the_map(scale: float) -> None:
    found = diagnosed(fit_around(Assumption(scale=scale)))
    assert found is not None
    assert found.fits is None
    assert "as stated" in line_of(found, CameraSpec(hfov_deg=45.0), 0.0)


def test_two_that_fit_alike_are_not_chosen_among() -> None:
    found = diagnosed(lambda tried: 4.0 if tried.turn_deg in (90.0, 270.0) else 0.0)
    assert found is not None
    assert found.fits is None
    assert "nothing is clear" in line_of(found, CameraSpec(hfov_deg=45.0), 0.0)


@pytest.mark.parametrize("confirmed", [True, False])
def test_what_is_named_must_fit_other_frames_too(confirmed: bool) -> None:
    truth = Assumption(turn_deg=180.0)
    tried, control = (
        cast(Trials, ScoredTrials(fit_around(truth, nats)))
        for nats in (4.0, 4.0 if confirmed else 0.5)
    )
    found = diagnose(tried, control)
    assert found is not None
    assert (found.fits == truth) is confirmed
    assert found.control_gain_nats is not None


def test_control_frames_are_others_than_those_tried() -> None:
    names = [f"{k}.png" for k in range(59)]
    tried, control = tried_and_control(names)
    assert (tried[0], len(tried), control[0], len(control)) == ("23.png", 12, "11.png", 12)
    assert tried_and_control(names[:14]) == (names[1:13], [])


def test_a_few_frames_are_not_diagnosed() -> None:
    assert diagnosed(fit_around(Assumption(turn_deg=90.0)), frames=5) is None
