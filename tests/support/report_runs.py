"""Runs of five frames whose figures are worked out by hand, for tests of the report."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from uasthn_cli.report.load import RunResults
from uasthn_cli.report.rows import FrameRow

FIVE_ROWS = (
    FrameRow("a.png", True, True, True, "", ce_m=4.0, mace_m=6.0, prior_ce_m=40.0),
    FrameRow("b.png", True, True, True, "", ce_m=30.0, mace_m=20.0, prior_ce_m=20.0),
    FrameRow("c.png", True, True, False, "uncertain", 100.0, 110.0, prior_ce_m=60.0),
    FrameRow("d.png", False, True, False, "off-map", math.nan, math.nan, prior_ce_m=10.0),
    FrameRow("e.png", False, False, False, "off-map", math.nan, math.nan, math.nan),
)


TRUST_COLUMNS: Final = (
    *("source", "confidence", "entropy", "sigma_m", "u_m", "agreement_m", "risk"),
    *("ce90_m", "camera_ce90_m"),
)


def fused_rows(count: int = 60, seed: int = 4) -> tuple[FrameRow, ...]:
    """Return frames whose risk is calibrated, fused and alone; alone, twice as many are wrong."""
    random = np.random.default_rng(seed)

    def answer(frame: str, risk: float) -> FrameRow:
        ce_m = float(random.uniform(30, 300) if random.uniform() < risk else random.uniform(0, 20))
        accepted = risk < 0.3
        return FrameRow(
            frame=frame,
            has_estimate=True,
            has_prior=True,
            accepted=accepted,
            reason="" if accepted else "uncertain",
            ce_m=ce_m,
            mace_m=ce_m,
            prior_ce_m=40.0,
            source="fix",
            confidence=1.0 - risk,
            entropy=float(random.uniform(0, 8)),
            sigma_m=5.0,
            u_m=risk * 50.0 + float(random.uniform(0, 20)),
            risk=risk,
            ce90_m=18.0,
            camera_ce_m=ce_m + 5.0,
            camera_ce90_m=20.0,
        )

    rows = []
    for k in range(count):
        name, risk = f"{k}.png", float(random.uniform(0, 0.5) ** 2 * 2)
        single = answer(name, min(2.0 * risk, 1.0))
        source = "flight" if k % 2 else "fix"
        rows.append(replace(answer(name, risk), source=source, single=single))
    return tuple(rows)


def make_run(*rows: FrameRow, **changes: Any) -> RunResults:
    """Return a run with truth; of the five frames unless others are given."""
    run = RunResults("out/run", "0.1.0", rows or FIVE_ROWS, has_truth=True, has_prior_error=True)
    return replace(run, **changes)


def write_folder(
    folder: Path, rows: tuple[FrameRow, ...] = FIVE_ROWS, with_truth: bool = True
) -> Path:
    """Write a results folder that holds just what the report reads of these rows."""
    errors = ["ce_m", "mace_m", "camera_ce_m", "prior_ce_m"] if with_truth else []
    table = [_cells(row, errors) for row in rows]
    folder.mkdir(parents=True)
    with (folder / "frames.csv").open("w", encoding="utf-8", newline="") as handle:
        writer = csv.DictWriter(handle, list(table[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)
    record = {"version": "0.1.0", "counts": {"frames": len(rows)}}
    (folder / "run.json").write_text(json.dumps(record), encoding="utf-8")
    return folder


def _cells(row: FrameRow, errors: list[str]) -> dict[str, str]:
    """Return the cells of a row; those of trust only if it speaks of any."""
    estimate = "24.0" if row.has_estimate else ""
    prior = "24.1" if row.has_prior else ""
    cells = {"frame": row.frame, "lat": estimate, "lon": estimate}
    cells |= {"accepted": str(row.accepted).lower(), "reason": row.reason}
    cells |= {"prior_lat": prior, "prior_lon": prior}
    cells |= {name: _cell(getattr(row, name)) for name in errors}
    if row.source:
        cells |= {name: _cell(getattr(row, name)) for name in TRUST_COLUMNS}
    if row.single is not None:
        single = _cells(row.single, errors)
        absent = ("frame", "lat", "lon", "prior_lat", "prior_lon", "prior_ce_m")
        camera = ("camera_ce_m", "camera_ce90_m")
        cells |= {
            f"single_{name}": cell for name, cell in single.items() if name not in absent + camera
        }
    return cells


def _cell(value: float | str) -> str:
    """Return a number as the writer of results would, or a word as it is."""
    if isinstance(value, str):
        return value
    return "" if math.isnan(value) else f"{value:.3f}"
