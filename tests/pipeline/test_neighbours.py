"""What frames near one say of the flight's answer, in words."""

import math

import numpy as np
from frame_results import make_failure, make_fix, make_prior, make_trust

from uasthn_cli.pipeline.flight_stage import FlightFrame
from uasthn_cli.pipeline.neighbours import neighbours_in_words
from uasthn_cli.types import Reason

NAN = math.nan


def words(*apart_m: float, index: int = 0, near: range | None = None) -> str:
    frames = []
    for k, distance_m in enumerate(apart_m):
        prior = make_prior(f"{k}.png")
        failure = make_failure(f"{k}.png", reason=Reason.TEXTURELESS, prior=prior)
        single = make_fix(f"{k}.png", trust=make_trust(confidence=0.5 + k / 10))
        frames.append(FlightFrame(prior, failure if math.isnan(distance_m) else single))
    return neighbours_in_words(frames, np.array(apart_m), near or range(len(frames)), index)


def test_runs_of_frames_that_say_otherwise_are_named_and_by_how_much() -> None:
    assert words(3.0, 50.0, 60.0, 90.0, NAN) == (
        "alone it agrees to 3 m; of 5 near frames 3 say otherwise (1.png … 3.png by 60 m),"
        " 1 says nothing, 1 agrees, 0.50 sure on average"
    )


def test_the_two_longest_runs_are_named_and_the_rest_counted() -> None:
    said = words(30.0, 1.0, 40.0, 40.0, 2.0, 70.0, 80.0, 90.0, index=0)
    assert "6 say otherwise (5.png … 7.png by 80 m, 2.png … 3.png by 40 m, and 1 more)" in said
    assert said.startswith("alone it says otherwise by 30 m; of 8 near frames")
    assert said.endswith("2 agree, 0.75 sure on average")


def test_only_near_frames_count() -> None:
    assert words(90.0, 90.0, 4.0, NAN, index=3, near=range(2, 4)) == (
        "alone it says nothing; of 2 near frames 1 says nothing, 1 agrees, 0.70 sure on average"
    )
