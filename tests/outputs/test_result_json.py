import math
from pathlib import Path

import numpy as np
import pytest
from frame_results import make_failure, make_fix
from hypothesis import given
from hypothesis import strategies as st

from uasthn_cli.outputs.result_json import decode_result, encode_result
from uasthn_cli.types import (
    Attitude,
    Fix,
    FrameFailure,
    FrameFile,
    FrameResult,
    Prior,
    Reason,
)

# Surrogates U+DC80..U+DCFF stand for undecodable bytes in file names on POSIX.
NAMES = st.text(st.characters(exclude_characters="\0", exclude_categories=())).filter(bool)
FLOATS = st.floats(allow_nan=True, allow_infinity=True)
MATRICES = st.lists(FLOATS, min_size=8, max_size=8).map(lambda v: np.array(v).reshape(4, 2))
REASONS = st.none() | st.sampled_from(Reason)
FRAMES = st.builds(FrameFile, name=NAMES, path=NAMES.map(Path))
PRIORS = st.builds(
    Prior,
    frame=FRAMES,
    time_utc_s=FLOATS,
    lat_deg=FLOATS,
    lon_deg=FLOATS,
    height_above_ground_m=FLOATS,
    attitude=st.builds(Attitude, FLOATS, FLOATS, FLOATS),
    height_source=NAMES,
)
FIXES = st.builds(
    Fix,
    prior=PRIORS,
    lat_deg=FLOATS,
    lon_deg=FLOATS,
    center_lat_deg=FLOATS,
    center_lon_deg=FLOATS,
    corners_deg=MATRICES,
    corner_std_m=MATRICES,
    uncertainty_m=FLOATS,
    offset_m=FLOATS,
    yaw_deg=FLOATS,
    gsd_m=FLOATS,
    confidence=FLOATS,
    accepted=st.booleans(),
    reason=REASONS,
    source=NAMES,
)
FAILURES = st.builds(
    FrameFailure,
    frame=FRAMES,
    reason=st.sampled_from(Reason),
    detail=st.text(),
    time_utc_s=st.none() | FLOATS,
    prior=st.none() | PRIORS,
)


def exact(value: object) -> object:
    """Return a value whose equality means: the same types and the same bits."""
    if isinstance(value, float):
        return "nan" if math.isnan(value) else value.hex()
    if isinstance(value, np.ndarray):
        return str(value.dtype), value.shape, [exact(item) for item in value.ravel().tolist()]
    slots = getattr(type(value), "__slots__", ())
    if slots and not isinstance(value, Path | str):
        return type(value), [exact(getattr(value, name)) for name in slots]
    return type(value), value


@given(FIXES | FAILURES)
def test_round_trip_is_exact(result: FrameResult) -> None:
    line = encode_result(result)
    assert line.isascii()
    assert len(line.splitlines()) == 1
    assert exact(decode_result(line)) == exact(result)


def test_numpy_scalars_become_plain_numbers_of_the_same_value() -> None:
    fix = make_fix(lat_deg=np.float32(24.1), accepted=np.bool_(False), confidence=np.float64(0.1))
    back = decode_result(encode_result(fix))
    assert isinstance(back, Fix)
    assert back.lat_deg == float(np.float32(24.1))
    assert back.accepted is False


@pytest.mark.parametrize("keep", [0.1, 0.5, 0.999])
def test_a_torn_line_is_no_result(keep: float) -> None:
    line = encode_result(make_fix())
    with pytest.raises(ValueError, match=r".+"):
        decode_result(line[: int(len(line) * keep)])


@pytest.mark.parametrize(
    "line",
    [
        "",
        "null",
        "[]",
        "3",
        "{}",
        '{"kind": "fix", "result": 5}',
        encode_result(make_failure()).replace("unreadable", "aliens"),
        encode_result(make_failure()).replace("detail", "details"),
        encode_result(make_fix()).replace("roll_rad", "roll_deg"),
        b"\x00\x00\xff",
    ],
)
def test_lines_of_other_shape_are_no_result(line: str | bytes) -> None:
    with pytest.raises(ValueError, match=r".+"):
        decode_result(line)


def test_foreign_objects_are_not_written() -> None:
    with pytest.raises(TypeError, match="set has no place"):
        encode_result(make_fix(source={1, 2}))
