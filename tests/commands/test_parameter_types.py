"""Option values: what is understood, and what is refused in one line."""

import click
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.commands.parameter_types import (
    ABOVE_ZERO,
    ANY_NUMBER,
    CrsType,
    DistortionType,
    EstimatorType,
    StdThresholdType,
)


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "0", "-3", "ten"])
def test_above_zero_refuses(text: str) -> None:
    with pytest.raises(click.BadParameter):
        ABOVE_ZERO(text)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_any_finite_number_reads_back(number: float) -> None:
    assert ANY_NUMBER(repr(number)) == number


@pytest.mark.parametrize(
    ("text", "threshold"),
    [("10m", (10.0, "m")), ("4px", (4.0, "px")), ("2.5 m", (2.5, "m")), (".5px", (0.5, "px"))],
)
def test_threshold_has_a_unit(text: str, threshold: tuple[float, str]) -> None:
    assert StdThresholdType().convert(text, None, None) == threshold


@pytest.mark.parametrize("text", ["10", "m", "0m", "-1px", "4 feet", "4pxm", "1e3m", "nanm"])
def test_threshold_without_meaning_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter, match="say 10m or 4px"):
        StdThresholdType().convert(text, None, None)


@given(st.sampled_from([4, 5, 8, 12, 14]).flatmap(lambda n: st.tuples(*[st.floats(-2, 2)] * n)))
def test_distortion_reads_back(coefficients: tuple[float, ...]) -> None:
    text = ",".join(map(repr, coefficients))
    assert DistortionType().convert(text, None, None) == coefficients


@pytest.mark.parametrize("text", ["", "a,b,c,d", "0,0,0,nan", "0,0,0,inf"])
def test_distortion_that_is_no_list_of_numbers_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter):
        DistortionType().convert(text, None, None)


@pytest.mark.parametrize("text", ["xcorr", "ncc", "vismatch:xfeat-star", "vismatch:loma-r"])
def test_estimator_is_understood(text: str) -> None:
    assert EstimatorType().convert(text, None, None) == text


@pytest.mark.parametrize(
    "text", ["", "sift", "XCORR", "vismatch", "vismatch:", "vismatch:a/b", "ncc:", "ncc:a"]
)
def test_unknown_estimator_is_refused_with_those_known(text: str) -> None:
    with pytest.raises(click.BadParameter, match=r"known: xcorr, ncc, dhn, .*vismatch:NAME"):
        EstimatorType().convert(text, None, None)


@pytest.mark.parametrize(
    ("text", "crs"), [("map", "map"), ("MAP", "map"), ("epsg:32640", "EPSG:32640")]
)
def test_crs_is_understood(text: str, crs: str) -> None:
    assert CrsType().convert(text, None, None) == crs


@pytest.mark.parametrize("text", ["", "32640", "EPSG:", "EPSG:utm", "+proj=utm"])
def test_other_crs_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter, match="EPSG:32640"):
        CrsType().convert(text, None, None)
