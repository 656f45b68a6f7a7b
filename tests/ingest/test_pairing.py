"""Frames and camera messages: paired right, or refused."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.config import PairBy
from uasthn_cli.ingest.pairing import Pairing, UnpairedError, pair_frames
from uasthn_cli.ingest.telemetry import CameraEvents, Stamps
from uasthn_cli.types import FloatArray, FrameFile

START_S = 1_700_000_000.0
COUNT = 30
UNEVEN_S: FloatArray = START_S + np.cumsum(np.random.default_rng(5).uniform(2.0, 8.0, COUNT))
STEADY_S: FloatArray = START_S + 2.0 * np.arange(COUNT, dtype=np.float64)


def events_at(times_s: FloatArray, sequence: Sequence[int]) -> CameraEvents:
    stamps = Stamps(np.arange(len(times_s)), times_s, np.full(len(times_s), np.nan))
    return CameraEvents(
        stamps, times_s, np.array(sequence), ("",) * len(times_s), "CAMERA_FEEDBACK"
    )


def frames_named(names: Sequence[object]) -> list[FrameFile]:
    return [FrameFile(f"{name}.png", Path("/nowhere") / f"{name}.png") for name in names]


def paired(
    exposures_s: FloatArray,
    files: Sequence[int],
    kept: Sequence[int],
    stated_s: FloatArray | None = None,
    names: Sequence[str] | None = None,
    by: PairBy = PairBy.AUTO,
) -> Pairing | None:
    """Pair the exposures that left a file with those that left a message."""
    times_s = exposures_s[list(kept)]
    unknown_s = np.full(len(files), np.nan)
    return pair_frames(
        frames_named(names or files),
        unknown_s if stated_s is None else stated_s,
        events_at(times_s, kept),
        times_s,
        by,
    )


def wrong(found: Pairing, files: Sequence[int], kept: Sequence[int]) -> int:
    return sum(
        index >= 0 and kept[index] != number
        for number, index in zip(files, found.index.tolist(), strict=True)
    )


@given(
    missing=st.sets(st.integers(0, COUNT - 1), max_size=6),
    lost=st.sets(st.integers(0, COUNT - 1), max_size=6),
    clock_s=st.sampled_from([0.0, -37.0, 7.3, 3600.0]),
    drift_ppm=st.sampled_from([0.0, 120.0]),
    is_whole=st.booleans(),
)
def test_uneven_exposures_pair_with_gaps_on_both_sides(
    missing: set[int], lost: set[int], clock_s: float, drift_ppm: float, is_whole: bool
) -> None:
    files = [k for k in range(COUNT) if k not in missing]
    kept = [k for k in range(COUNT) if k not in lost]
    stated_s = UNEVEN_S[files] + 1e-6 * drift_ppm * (UNEVEN_S[files] - START_S) - clock_s
    try:
        found = paired(UNEVEN_S, files, kept, np.floor(stated_s) if is_whole else stated_s)
    except UnpairedError:
        assert is_whole
        assert len(missing) + len(lost) > COUNT / 10, "so few that are lost leave no doubt"
        return
    assert found is not None
    assert found.by is PairBy.TIME
    assert wrong(found, files, kept) == 0
    assert (found.index >= 0).sum() >= len(set(files) & set(kept)) - 1


@pytest.mark.parametrize("clock_s", [0.2, -37.0, 7.0])
def test_a_steady_pace_is_refused_unless_forced(clock_s: float) -> None:
    files, kept = list(range(3, 25)), list(range(COUNT))
    stated_s = STEADY_S[files] - clock_s
    with pytest.raises(UnpairedError, match="either may be right"):
        paired(STEADY_S, files, kept, stated_s)
    assert paired(STEADY_S, files, kept, stated_s, by=PairBy.TIME) is not None


def test_a_steady_pace_pairs_where_nothing_is_left_over() -> None:
    everything = list(range(COUNT))
    found = paired(STEADY_S, everything, everything, STEADY_S + 37.0)
    assert found is not None
    assert found.index.tolist() == everything
    assert found.shift_s == pytest.approx(-37.0, abs=0.01)


def test_dates_that_are_days_apart_are_refused_unless_forced() -> None:
    everything = list(range(COUNT))
    stated_s = UNEVEN_S - 592 * 86_400.0
    with pytest.raises(UnpairedError, match="dated 592 days before the log"):
        paired(UNEVEN_S, everything, everything, stated_s)
    found = paired(UNEVEN_S, everything, everything, stated_s, by=PairBy.TIME)
    assert found is not None
    assert wrong(found, everything, everything) == 0


def test_frames_that_were_deleted_and_numbered_anew_are_refused() -> None:
    """So measured: 22 of 36 frames got times up to 14.2 s off, and nothing said so."""
    files = [k for k in range(COUNT) if k not in (9, 10, 20)]
    names = [f"frame_{k:04d}" for k in range(1, len(files) + 1)]
    with pytest.raises(UnpairedError, match="which are missing cannot be told"):
        paired(UNEVEN_S, files, list(range(COUNT)), names=names)


def test_without_times_and_numbers_the_counts_decide() -> None:
    letters = [chr(ord("a") + k) for k in range(5)]
    found = paired(UNEVEN_S, range(5), range(5), names=letters)
    assert found is not None
    assert (found.by, found.index.tolist()) == (PairBy.ORDER, [0, 1, 2, 3, 4])
    with pytest.raises(UnpairedError, match="5 frames and 6 messages"):
        paired(UNEVEN_S, range(5), range(6), names=letters)


def test_equal_counts_with_a_gap_are_not_paired_in_order() -> None:
    kept = [k for k in range(COUNT) if k != 4]
    names = [f"f{k}" for k in range(1, COUNT)]
    with pytest.raises(UnpairedError, match="numbered 0 to 29"):
        paired(UNEVEN_S, kept, kept, names=names)


def test_a_counter_that_goes_on_from_flight_to_flight_pairs_by_number() -> None:
    kept = [121, 122, 124, 125, 128, 130]
    times_s = START_S + np.arange(6.0)
    found = pair_frames(
        frames_named(["IMG_0122", "IMG_0123", "IMG_0125", "IMG_0130"]),
        np.full(4, np.nan),
        events_at(times_s, kept),
        times_s,
    )
    assert found is not None
    assert (found.by, found.index.tolist()) == (PairBy.NUMBER, [1, -1, 3, 5])


def test_numbers_may_be_believed_on_demand() -> None:
    files = [0, 1, 2, 4, 5]
    names = [f"f{k + 1}" for k in files]
    found = paired(UNEVEN_S, files, range(6), names=names, by=PairBy.NUMBER)
    assert found is not None
    assert found.index.tolist() == files
    assert "less 1" in found.why


def test_messages_that_meet_few_frames_are_refused_and_a_few_are_left_alone() -> None:
    stated_s = START_S + np.sort(np.random.default_rng(1).uniform(0, 600, 12))
    with pytest.raises(UnpairedError, match=r"no better than by chance|meet a message"):
        paired(UNEVEN_S[:12], range(12), range(12), stated_s)
    assert paired(UNEVEN_S[:4], range(12), range(4), stated_s) is None


def test_a_name_that_several_frames_have_tells_nothing() -> None:
    times_s = START_S + np.arange(2.0)
    events = events_at(times_s, [0, 1])
    events = replace(events, file_names=("x0.png", "x1.png"))
    frames = frames_named(["a/x0", "b/x0", "x1"])
    found = pair_frames(frames, np.full(3, np.nan), events, times_s)
    assert found is not None
    assert (found.by, found.index.tolist()) == (PairBy.NAME, [-1, -1, 1])
    assert found.describe(["a/x0", "b/x0", "x1"])["messages_without_frame"] == 1


def test_names_that_are_asked_for_must_be_there() -> None:
    with pytest.raises(UnpairedError, match="no message names"):
        paired(UNEVEN_S, range(COUNT), range(COUNT), UNEVEN_S, by=PairBy.NAME)


moments = st.integers(0, 4000).map(lambda tenth: START_S + tenth / 20)


@given(
    times_s=st.lists(moments, max_size=12),
    stated_s=st.lists(moments | st.just(float("nan")), min_size=1, max_size=12),
    by=st.sampled_from(PairBy),
)
def test_any_times_are_paired_left_alone_or_refused(
    times_s: list[float], stated_s: list[float], by: PairBy
) -> None:
    ordered_s = np.sort(np.array(times_s, dtype=np.float64))
    events = events_at(ordered_s, range(len(ordered_s)))
    try:
        found = pair_frames(
            frames_named(range(len(stated_s))), np.array(stated_s), events, ordered_s, by
        )
    except UnpairedError:
        return
    if found is not None:
        used = found.index[found.index >= 0]
        assert found.index.shape == (len(stated_s),)
        assert len(np.unique(used)) == len(used)
        assert (used < len(ordered_s)).all()
