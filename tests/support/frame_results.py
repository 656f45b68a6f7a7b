"""Factories of what the pipeline yields, for tests of outputs, report and commands."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from uasthn_cli.outputs.run_record import RunRecord, RunTiming
from uasthn_cli.types import (
    Attitude,
    CameraModel,
    Fix,
    FrameFailure,
    FrameFile,
    FrameResult,
    Located,
    OffsetLikelihood,
    Prior,
    Reason,
    RefinedFrame,
    Source,
    Trust,
)

CORNERS_DEG = np.array([[24.002, 56.001], [24.002, 56.004], [24.0, 56.001], [24.0, 56.004]])
"""A north-up footprint: top-left, top-right, bottom-left, bottom-right as ``(lat, lon)``."""


UNCERTAIN_DETAIL = "frame and views disagree by 12.35 m, at most 10.00 m"


def make_frame(name: str = "a.png") -> FrameFile:
    """Return a frame file that need not exist."""
    return FrameFile(name=name, path=Path("frames") / name)


def make_prior(name: str = "a.png", **changes: Any) -> Prior:
    """Return a prior near the footprint."""
    prior = Prior(
        frame=make_frame(name),
        time_utc_s=1_763_800_002.0,
        lat_deg=24.0005,
        lon_deg=56.002,
        height_above_ground_m=267.73,
        attitude=Attitude(roll_rad=0.01, pitch_rad=-0.02, yaw_rad=1.5),
        height_source="relative_alt",
        alt_amsl_m=317.5,
    )
    return replace(prior, **changes)


def make_trust(**changes: Any) -> Trust:
    """Return what is known of a frame's own answer, judged by a calibration."""
    trust = Trust(
        confidence=0.87654,
        entropy_nats=3.25,
        sigma_m=12.5,
        covariance_m2=np.array([[10.0, -1.5], [-1.5, 12.0]]),
        ce90_m=7.125,
        risk=0.0123456,
        agreement_m=math.nan,
        support=math.nan,
    )
    return replace(trust, **changes)


def make_fix(name: str = "a.png", **changes: Any) -> Fix:
    """Return an accepted estimate."""
    fix = Fix(
        prior=make_prior(name),
        lat_deg=24.001,
        lon_deg=56.0025,
        center_lat_deg=24.00101,
        center_lon_deg=56.00251,
        corners_deg=CORNERS_DEG.copy(),
        corner_std_m=np.arange(1.0, 9.0).reshape(4, 2),
        uncertainty_m=4.5,
        offset_m=75.25,
        roll_deg=0.573,
        pitch_deg=-1.1459,
        yaw_deg=85.9437,
        height_above_ground_m=270.25,
        alt_amsl_m=317.625,
        gsd_m=0.345678,
        trust=make_trust(),
        camera_covariance_m2=np.array([[20.0, -2.5], [-2.5, 24.0]]),
        camera_ce90_m=10.065,
        accepted=True,
        reason=None,
    )
    return replace(fix, **changes)


def make_rejected(name: str = "b.png", **changes: Any) -> Fix:
    """Return a rejected estimate."""
    verdict = {"accepted": False, "reason": Reason.UNCERTAIN, "detail": UNCERTAIN_DETAIL}
    return make_fix(name, **(verdict | changes))


def make_failure(name: str = "c.png", **changes: Any) -> FrameFailure:
    """Return a frame without an estimate, time or prior."""
    failure = FrameFailure(make_frame(name), Reason.UNREADABLE, "truncated PNG")
    return replace(failure, **changes)


def make_fused(name: str = "a.png", **changes: Any) -> Fix:
    """Return the flight's answer for a frame whose own lies beside it and is rejected."""
    trust = make_trust(risk=0.001, agreement_m=4.0, support=0.8888)
    fused = make_fix(name, trust=trust, source=Source.FUSED, single=make_rejected(name))
    return replace(fused, **changes)


def make_likelihood(size: int = 5, seed: int = 0) -> OffsetLikelihood:
    """Return a likelihood of noise."""
    noise = np.random.default_rng(seed).uniform(-60.0, 0.0, (size, size))
    return OffsetLikelihood.of(noise, 2.5, np.array([1.5, -0.75]))


def make_located(name: str = "a.png", **changes: Any) -> Located:
    """Return what a frame with an estimate gave alone."""
    return replace(Located(make_fix(name), make_likelihood()), **changes)


def located(result: FrameResult) -> Located:
    """Return a frame that gave a result and no likelihood."""
    return Located(result, None)


def make_refined_frame(name: str = "a.png", **changes: Any) -> RefinedFrame:
    """Return a frame refined near its place."""
    camera = CameraModel(640, 512, 700.0, 700.0, 319.5, 255.5, (0.1, -0.05), 0.25)
    return replace(RefinedFrame(make_frame(name), camera, make_likelihood(7, 1)), **changes)


def make_record(**changes: Any) -> RunRecord:
    """Return a run record of made-up sections."""
    timing = RunTiming(1_767_323_045.0, 2.0, 3, {"decode": 0.5, "search": 1.0})
    record = RunRecord(
        arguments={"estimator": "ncc", "search_radius_m": 200.0},
        time_base={"chosen": "record", "why": "SYSTEM_TIME drifts"},
        frame_times={"source": "file names"},
        camera={"hfov_deg": 45.0},
        inputs={"map": {"path": "map.tif", "sha256": "0" * 64}},
        timing=timing,
    )
    return replace(record, **changes)


def truth_table(*rows: dict[str, Any], with_camera: bool = True) -> str:
    """Return a truth CSV; a row gives ``frame`` and what differs from ``make_fix``'s footprint."""
    corners = {
        f"{corner}_{axis}": float(CORNERS_DEG[k, a])
        for k, corner in enumerate(("tl", "tr", "bl", "br"))
        for a, axis in enumerate(("lat", "lon"))
    }
    camera = {"lat": 24.001, "lon": 56.0025} if with_camera else {}
    base = {**camera, "center_lat": 24.00101, "center_lon": 56.00251, **corners}
    lines = [",".join(["frame", *base])]
    for row in rows:
        values = base | row
        lines.append(",".join(str(values[name]) for name in ("frame", *base)))
    return "\n".join(lines) + "\n"


def listing(folder: Path) -> list[str]:
    """Return the names in a folder, hidden ones included."""
    return sorted(path.name for path in folder.iterdir())
