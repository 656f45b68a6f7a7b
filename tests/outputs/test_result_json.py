import math
from pathlib import Path

import numpy as np
import pytest
from frame_results import (
    located,
    make_failure,
    make_fix,
    make_fused,
    make_located,
    make_refined_frame,
)
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from uasthn_cli.outputs.result_json import (
    decode_located,
    decode_refined_frame,
    encode_located,
    encode_refined_frame,
)
from uasthn_cli.types import (
    Attitude,
    CameraModel,
    Fix,
    FrameFailure,
    FrameFile,
    Located,
    OffsetLikelihood,
    Prior,
    Reason,
    RefinedFrame,
    Source,
    Trust,
)

# Surrogates U+DC80..U+DCFF stand for undecodable bytes in file names on POSIX.
NAMES = st.text(st.characters(exclude_characters="\0", exclude_categories=())).filter(bool)
FLOATS = st.floats(allow_nan=True, allow_infinity=True)


def matrices(rows: int, columns: int) -> st.SearchStrategy[NDArray[np.float64]]:
    """Return arrays of one shape."""
    count = rows * columns
    values = st.lists(FLOATS, min_size=count, max_size=count)
    return values.map(lambda chosen: np.array(chosen).reshape(rows, columns))


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
    alt_amsl_m=FLOATS,
)
TRUSTS = st.builds(
    Trust,
    confidence=FLOATS,
    entropy_nats=FLOATS,
    sigma_m=FLOATS,
    covariance_m2=matrices(2, 2),
    ce90_m=FLOATS,
    risk=FLOATS,
    agreement_m=FLOATS,
    support=FLOATS,
)


def fixes(single: st.SearchStrategy[Fix | None]) -> st.SearchStrategy[Fix]:
    """Return estimates that hold a frame's own beside them."""
    return st.builds(
        Fix,
        prior=PRIORS,
        lat_deg=FLOATS,
        lon_deg=FLOATS,
        center_lat_deg=FLOATS,
        center_lon_deg=FLOATS,
        corners_deg=matrices(4, 2),
        corner_std_m=matrices(4, 2),
        uncertainty_m=FLOATS,
        offset_m=FLOATS,
        roll_deg=FLOATS,
        pitch_deg=FLOATS,
        yaw_deg=FLOATS,
        height_above_ground_m=FLOATS,
        alt_amsl_m=FLOATS,
        gsd_m=FLOATS,
        trust=TRUSTS,
        camera_covariance_m2=matrices(2, 2),
        camera_ce90_m=FLOATS,
        accepted=st.booleans(),
        reason=REASONS,
        detail=st.text(),
        source=st.sampled_from(Source),
        single=single,
    )


FIXES = fixes(st.none() | fixes(st.none()))
FAILURES = st.builds(
    FrameFailure,
    frame=FRAMES,
    reason=st.sampled_from(Reason),
    detail=st.text(),
    time_utc_s=st.none() | FLOATS,
    prior=st.none() | PRIORS,
)

LIKELIHOODS = st.builds(
    OffsetLikelihood,
    levels=st.integers(0, 4).flatmap(lambda half: arrays(np.uint8, (2 * half + 1,) * 2)),
    cell_m=FLOATS,
    centre_m=st.tuples(FLOATS, FLOATS).map(np.array),
)
CAMERAS = st.builds(
    CameraModel,
    width_px=st.integers(1, 9999),
    height_px=st.integers(1, 9999),
    focal_x_px=FLOATS,
    focal_y_px=FLOATS,
    principal_x_px=FLOATS,
    principal_y_px=FLOATS,
    distortion=st.lists(FLOATS, max_size=5).map(tuple),
    mount_yaw_rad=FLOATS,
)


def exact(value: object) -> object:
    """Return a value whose equality means: the same types and the same bits."""
    if isinstance(value, float):
        return "nan" if math.isnan(value) else value.hex()
    if isinstance(value, np.ndarray):
        return str(value.dtype), value.shape, [exact(item) for item in value.ravel().tolist()]
    if isinstance(value, tuple):
        return [exact(item) for item in value]
    slots = getattr(type(value), "__slots__", ())
    if slots and not isinstance(value, Path | str):
        return type(value), [exact(getattr(value, name)) for name in slots]
    return type(value), value


@given(st.builds(Located, result=FIXES | FAILURES, likelihood=st.none() | LIKELIHOODS))
def test_round_trip_is_exact(entry: Located) -> None:
    line = encode_located(entry)
    assert line.isascii()
    assert len(line.splitlines()) == 1
    assert exact(decode_located(line)) == exact(entry)


REFINED_FRAMES = st.builds(
    RefinedFrame,
    frame=FRAMES,
    camera=st.none() | CAMERAS,
    likelihood=st.none() | LIKELIHOODS,
)


@given(REFINED_FRAMES)
def test_round_trip_of_a_refined_frame_is_exact(refined: RefinedFrame) -> None:
    line = encode_refined_frame(refined)
    assert line.isascii()
    assert len(line.splitlines()) == 1
    assert exact(decode_refined_frame(line)) == exact(refined)


def test_numpy_scalars_become_plain_numbers_of_the_same_value() -> None:
    fix = make_fix(
        lat_deg=np.float32(24.1), accepted=np.bool_(False), uncertainty_m=np.float64(0.1)
    )
    back = decode_located(encode_located(located(fix))).result
    assert isinstance(back, Fix)
    assert back.lat_deg == float(np.float32(24.1))
    assert back.accepted is False


def test_a_flight_of_a_thousand_frames_fits_in_memory_and_on_disk() -> None:
    """A packed likelihood of 201 × 201 smooth levels takes a fraction of its JSON numbers."""
    east, north = np.meshgrid(np.linspace(-1, 1, 201), np.linspace(-1, 1, 201))
    smooth = -20.0 * (east**2 + north**2)
    entry = make_located(likelihood=OffsetLikelihood.of(smooth, 2.0, np.zeros(2)))
    assert len(encode_located(entry)) < 201 * 201


@pytest.mark.parametrize("keep", [0.1, 0.5, 0.999])
def test_a_torn_line_is_no_result(keep: float) -> None:
    line = encode_located(make_located(result=make_fused()))
    with pytest.raises(ValueError, match=r".+"):
        decode_located(line[: int(len(line) * keep)])
    refined = encode_refined_frame(make_refined_frame())
    with pytest.raises(ValueError, match=r".+"):
        decode_refined_frame(refined[: int(len(refined) * keep)])


FAILURE_LINE = encode_located(located(make_failure()))
FIX_LINE = encode_located(make_located())


@pytest.mark.parametrize(
    "line",
    [
        "",
        "null",
        "[]",
        "3",
        "{}",
        '{"kind": "fix", "result": 5}',
        FAILURE_LINE.replace("unreadable", "aliens"),
        FAILURE_LINE.replace("detail", "details"),
        FIX_LINE.replace("roll_rad", "roll_deg"),
        FIX_LINE.replace("ce90_m", "ce95_m"),
        FIX_LINE.replace('"source": "fix"', '"source": "hearsay"'),
        FIX_LINE.replace('"size": 5', '"size": 6'),
        FIX_LINE.replace('"levels": "', '"levels": "000'),
        FIX_LINE.replace('"levels": "', '"levels": "!'),
        encode_refined_frame(make_refined_frame()),
        b"\x00\x00\xff",
    ],
)
def test_lines_of_other_shape_are_no_result(line: str | bytes) -> None:
    with pytest.raises(ValueError, match=r".+"):
        decode_located(line)


REFINED_LINE = encode_refined_frame(make_refined_frame())


@pytest.mark.parametrize(
    "line",
    [
        "null",
        "{}",
        FIX_LINE,
        REFINED_LINE.replace("focal_x_px", "focal_px"),
        REFINED_LINE.replace('"size": 7', '"size": 5'),
        REFINED_LINE.replace("cell_m", "cell"),
    ],
)
def test_lines_of_other_shape_are_no_refined_frame(line: str) -> None:
    with pytest.raises(ValueError, match=r".+"):
        decode_refined_frame(line)


def test_foreign_objects_are_not_written() -> None:
    with pytest.raises(TypeError, match="set has no place"):
        encode_located(located(make_fix(source={1, 2})))
