"""Between samples, never beyond them."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.ingest.interpolate import (
    AmbiguousTimeError,
    Bracket,
    OutsideLogError,
    Segment,
    Track,
    linear_position,
    slerp_attitude,
)

angles = st.floats(-math.pi, math.pi)


def track(*times: tuple[float, ...]) -> Track:
    """Return a track whose only value is the time itself."""
    return Track("position", tuple(Segment(np.array(t), np.array(t)[:, None]) for t in times))


def turn(a: float, b: float) -> float:
    """Return the angle from b to a, the short way."""
    return math.remainder(a - b, 2.0 * math.pi)


@given(yaw=angles, change=st.floats(-1.5, 1.5), fraction=st.floats(0.0, 1.0))
def test_yaw_takes_the_short_way_round(yaw: float, change: float, fraction: float) -> None:
    before = np.array([0.0, 0.0, yaw])
    after = np.array([0.0, 0.0, math.remainder(yaw + change, 2.0 * math.pi)])
    attitude = slerp_attitude(Bracket(before, after, fraction))
    assert abs(turn(attitude.yaw_rad, yaw + fraction * change)) < 1e-9
    assert abs(attitude.roll_rad) + abs(attitude.pitch_rad) < 1e-9


@given(roll=st.floats(-0.5, 0.5), pitch=st.floats(-0.5, 0.5), yaw=angles)
def test_samples_themselves_come_back(roll: float, pitch: float, yaw: float) -> None:
    sample, other = np.array([roll, pitch, yaw]), np.array([0.1, -0.1, yaw + 0.4])
    for bracket in (Bracket(sample, other, 0.0), Bracket(other, sample, 1.0)):
        attitude = slerp_attitude(bracket)
        assert abs(attitude.roll_rad - roll) + abs(attitude.pitch_rad - pitch) < 1e-9
        assert abs(turn(attitude.yaw_rad, yaw)) < 1e-9


@given(fraction=st.floats(0.0, 1.0))
def test_the_date_line_is_crossed_the_short_way(fraction: float) -> None:
    before, after = np.array([10.0, 179.9, 50.0]), np.array([10.2, -179.9, 60.0])
    lat_deg, lon_deg, height_m = linear_position(Bracket(before, after, fraction))
    assert lat_deg == pytest.approx(10.0 + 0.2 * fraction)
    assert abs(math.remainder(lon_deg - (179.9 + 0.2 * fraction), 360.0)) < 1e-9
    assert height_m == pytest.approx(50.0 + 10.0 * fraction)


@given(st.floats(0.0, 8.0), st.floats(0.1, 10.0))
def test_brackets_enclose_or_refuse(time_s: float, max_gap_s: float) -> None:
    times_s = (1.0, 2.0, 2.5, 6.0, 6.5)
    try:
        bracket = track(times_s).bracket(time_s, max_gap_s)
    except OutsideLogError:
        gaps_s = [b - a for a, b in itertools.pairwise(times_s) if a <= time_s <= b]
        assert time_s not in times_s
        assert not gaps_s or min(gaps_s) > max_gap_s
    else:
        before, after = float(bracket.before[0]), float(bracket.after[0])
        assert before <= time_s <= after
        assert after - before <= max_gap_s
        assert before + bracket.fraction * (after - before) == pytest.approx(time_s)


@pytest.mark.parametrize(
    ("time_s", "words"),
    [
        (0.5, "0.5 s before the log's first position"),
        (8.0, "1.5 s after the log's last position"),
        (4.0, "in a gap of 3.5 s between two positions (at most 2 s)"),
        (6.5 + 7200.0, "2.0 h after"),
        (6.5 + 30 * 86400.0, "30 days after"),
    ],
)
def test_refusals_give_the_numbers(time_s: float, words: str) -> None:
    with pytest.raises(OutsideLogError) as caught:
        track((1.0, 2.0, 2.5, 6.0, 6.5)).bracket(time_s, 2.0)
    assert words in str(caught.value)


def test_sessions_are_not_bridged_and_overlaps_are_named() -> None:
    with pytest.raises(OutsideLogError):
        track((1.0, 2.0), (3.0, 4.0)).bracket(2.5, 10.0)
    with pytest.raises(AmbiguousTimeError, match="set back"):
        track((1.0, 2.0), (1.5, 2.5)).bracket(1.7, 10.0)


def test_a_single_sample_holds_for_its_instant_only() -> None:
    assert track((1.0,)).bracket(1.0, 2.0).before == 1.0
    with pytest.raises(OutsideLogError):
        track((1.0,)).bracket(1.1, 2.0)
    with pytest.raises(OutsideLogError, match="no position"):
        track().bracket(1.0, 2.0)
