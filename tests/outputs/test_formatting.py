import math

import pytest
from frame_results import make_failure, make_fix, make_prior
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.outputs.formatting import (
    finite_or_none,
    fixed,
    frame_of,
    iso_utc,
    safe_text,
    time_of,
)


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [
        (1.0, 3, "1.000"),
        (-0.0004, 3, "0.000"),
        (-0.0006, 3, "-0.001"),
        (1e-9, 8, "0.00000000"),
        (None, 3, ""),
        (math.nan, 3, ""),
        (-math.inf, 3, ""),
    ],
)
def test_fixed_decimals(value: float | None, decimals: int, text: str) -> None:
    assert fixed(value, decimals) == text


@given(st.floats(-180, 180))
def test_fixed_is_within_half_a_step(value: float) -> None:
    assert abs(float(fixed(value, 8)) - value) <= 0.5e-8 + 1e-13


def test_json_numbers_are_rounded_or_none() -> None:
    assert finite_or_none(1.23456, 3) == 1.235
    assert finite_or_none(math.nan, 3) is None


@pytest.mark.parametrize(
    ("time_utc_s", "text"),
    [
        (1_763_800_002.0, "2025-11-22T08:26:42.000Z"),
        (0.0005, "1970-01-01T00:00:00.000Z"),
        (1.9996, "1970-01-01T00:00:02.000Z"),
        (-0.25, "1969-12-31T23:59:59.750Z"),
        (None, ""),
        (math.nan, ""),
        (1e18, ""),
    ],
)
def test_times_are_iso_8601_to_the_nearest_millisecond(time_utc_s: float | None, text: str) -> None:
    assert iso_utc(time_utc_s) == text


def test_names_with_undecodable_bytes_can_be_written() -> None:
    assert safe_text("flug_ä_\udcff.png").encode("utf-8") == "flug_ä_\\udcff.png".encode()


def test_time_is_the_failures_own_or_the_priors() -> None:
    assert time_of(make_fix()) == 1_763_800_002.0
    assert time_of(make_failure()) is None
    assert time_of(make_failure(prior=make_prior(time_utc_s=5.0))) == 5.0
    assert time_of(make_failure(prior=make_prior(time_utc_s=5.0), time_utc_s=7.0)) == 7.0


def test_frame_of_either_kind() -> None:
    assert frame_of(make_fix("x.png")).name == "x.png"
    assert frame_of(make_failure("y.png")).name == "y.png"
