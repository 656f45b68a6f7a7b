"""Times in names and in text."""

from datetime import UTC, datetime, timedelta, timezone

import pytest
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.ingest.timestamps import parse_time, time_in_name

EXAMPLE = datetime(2018, 8, 5, 1, 0, 44, 800_000, tzinfo=UTC).timestamp()

moments = st.datetimes(datetime(2001, 9, 10), datetime(2032, 1, 1)).map(
    lambda moment: moment.replace(microsecond=moment.microsecond // 1000 * 1000, tzinfo=UTC)
)


@pytest.mark.parametrize(
    ("stem", "expected_s", "is_local"),
    [
        ("2018080501004480Z", EXAMPLE, False),
        ("frame_1533430844800", EXAMPLE, False),
        ("frame_1533430844.8", EXAMPLE, False),
        ("1533430844800000", EXAMPLE, False),
        ("1533430844800000000", EXAMPLE, False),
        ("cam0-1533430844", EXAMPLE - 0.8, False),
        ("2018-08-05T01-00-44.8Z", EXAMPLE, False),
        ("20180805T010044.800Z", EXAMPLE, False),
        ("2018-08-05_11-00-44.8+10:00", EXAMPLE, False),
        ("20180805T110044+1000_thermal", EXAMPLE - 0.8, False),
        ("20180805010044800", EXAMPLE, True),
        ("IMG_20180805_010044", EXAMPLE - 0.8, True),
        ("DJI_20180805010044_0001_T", EXAMPLE - 0.8, True),
    ],
)
def test_names_that_tell_a_time(stem: str, expected_s: float, is_local: bool) -> None:
    found = time_in_name(stem)
    assert found is not None
    assert found.time_s == pytest.approx(expected_s, abs=1e-5)
    assert found.is_local is is_local


@pytest.mark.parametrize(
    "stem",
    ["DJI_0001", "0_110_90_0_03806", "frame_000123", "20189905010044Z", "123456789012", "thermal"],
)
def test_names_that_do_not(stem: str) -> None:
    assert time_in_name(stem) is None


@given(moments, st.sampled_from(["", "frame_", "cam-1_"]), st.sampled_from(["", "_T", "-raw"]))
def test_every_spelling_comes_back(moment: datetime, before: str, after: str) -> None:
    milliseconds = round(moment.timestamp() * 1000)
    spellings = (
        f"{milliseconds}",
        f"{milliseconds * 1000}",
        f"{milliseconds / 1000:.3f}",
        moment.strftime("%Y%m%d%H%M%S") + f"{milliseconds % 1000:03d}Z",
        moment.strftime("%Y-%m-%dT%H-%M-%S.") + f"{milliseconds % 1000:03d}Z",
        moment.strftime("%Y%m%d_%H%M%S.") + f"{milliseconds % 1000:03d}",
    )
    for spelling in spellings:
        found = time_in_name(before + spelling + after)
        assert found is not None, spelling
        assert found.time_s == pytest.approx(moment.timestamp(), abs=1e-4)


@given(moments, st.integers(-12 * 60, 14 * 60))
def test_iso_8601_with_any_offset_comes_back(moment: datetime, offset_min: int) -> None:
    zoned = moment.astimezone(timezone(timedelta(minutes=offset_min)))
    for separator in "T ":
        found = parse_time(zoned.isoformat(separator))
        assert found is not None
        assert not found.is_local
        assert found.time_s == pytest.approx(moment.timestamp(), abs=1e-5)


@given(moments, st.sampled_from([1, 1_000, 1_000_000, 1_000_000_000]))
def test_numbers_tell_their_unit_by_their_size(moment: datetime, per_second: int) -> None:
    found = parse_time(str(round(moment.timestamp()) * per_second))
    assert found is not None
    assert found.time_s == pytest.approx(round(moment.timestamp()), abs=1e-5)


@given(st.text(max_size=40))
def test_any_text_is_a_time_in_this_century_or_none(text: str) -> None:
    for found in (time_in_name(text), parse_time(text)):
        assert found is None or 2000 <= datetime.fromtimestamp(found.time_s, UTC).year < 2100


@pytest.mark.parametrize("text", ["", "12.5", "noon", "2018-13-05T01:00:44", "nan", "1e30", "-5"])
def test_other_text_is_no_time(text: str) -> None:
    assert parse_time(text) is None


def test_exif_spelling() -> None:
    found = parse_time("2018:08:05 01:00:44.80")
    assert found is not None
    assert found.is_local
    assert found.time_s == pytest.approx(EXAMPLE, abs=1e-5)
