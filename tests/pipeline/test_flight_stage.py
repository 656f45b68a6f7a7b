"""The refinement reaches as far as the search may err, on a grid of bounded size."""

from types import SimpleNamespace
from typing import cast

import pytest
from frame_results import make_failure, make_fix, make_likelihood, make_prior

from uasthn_cli.fusion.offsets import OffsetGrid, grid_of_radius
from uasthn_cli.pipeline.flight_stage import FlightStage, flight_frames
from uasthn_cli.pipeline.frame_matcher import FrameMatcher
from uasthn_cli.types import Located, Reason


def refine_grid(pitch_m: float, search: OffsetGrid) -> OffsetGrid:
    matcher = cast(FrameMatcher, SimpleNamespace(pitch_m=pitch_m, local=None))
    return FlightStage(matcher, matcher, search, lambda _: {}).refine_grid


@pytest.mark.parametrize(
    ("pitch_m", "radius_m", "reach_m"),
    [
        (1.0, 200.0, 15.0),
        (4.0, 200.0, 20.0),
        (1.0, 1000.0, 15.0),  # cells of 10 m
        (1.0, 2000.0, 25.0),  # cells of 20 m
        (1.0, 5000.0, 62.5),  # cells of 50 m
    ],
)
def test_the_refinement_reaches_beyond_a_cell_of_the_search(
    pitch_m: float, radius_m: float, reach_m: float
) -> None:
    grid = refine_grid(pitch_m, grid_of_radius(radius_m, pitch_m))
    assert grid.half * grid.cell_m == pytest.approx(reach_m, abs=grid.cell_m / 2)
    assert grid.size <= 301
    if reach_m <= 25.0:
        assert grid.cell_m == pitch_m / 4


def test_frames_are_taken_in_order_of_time_with_their_likelihoods() -> None:
    entries = [
        Located(make_fix(f"{k}.png", prior=make_prior(f"{k}.png", time_utc_s=time_s)), seen)
        for k, (time_s, seen) in enumerate(
            [(30.0, make_likelihood(seed=1)), (10.0, None), (20.0, make_likelihood(seed=3))]
        )
    ]
    blank = make_failure("3.png", reason=Reason.TEXTURELESS, prior=make_prior(time_utc_s=15.0))
    lost = make_failure("4.png", prior=make_prior(time_utc_s=5.0))
    frames, likelihoods = flight_frames(
        iter([*entries, Located(blank, None), Located(lost, None), Located(make_failure(), None)])
    )
    assert [frame.prior.time_utc_s for frame in frames] == [10.0, 15.0, 20.0, 30.0]
    assert [frame.result for frame in frames][1] is blank
    levels = [None if entry is None else entry.levels.tolist() for entry in likelihoods]
    seeds = [None, None, 3, 1]
    assert levels == [None if s is None else make_likelihood(seed=s).levels.tolist() for s in seeds]
