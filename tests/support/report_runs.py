"""Runs of five frames whose figures are worked out by hand, for tests of the report."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from uasthn_cli.report.load import RunResults
from uasthn_cli.report.rows import FrameRow

FIVE_ROWS = (
    FrameRow("a.png", True, True, True, "", ce_m=4.0, mace_m=6.0, prior_ce_m=40.0),
    FrameRow("b.png", True, True, True, "", ce_m=30.0, mace_m=20.0, prior_ce_m=20.0),
    FrameRow("c.png", True, True, False, "uncertain", 100.0, 110.0, prior_ce_m=60.0),
    FrameRow("d.png", False, True, False, "off-map", math.nan, math.nan, prior_ce_m=10.0),
    FrameRow("e.png", False, False, False, "off-map", math.nan, math.nan, math.nan),
)


def make_run(*rows: FrameRow, **changes: Any) -> RunResults:
    """Return a run with truth; of the five frames unless others are given."""
    run = RunResults("out/run", "0.1.0", rows or FIVE_ROWS, has_truth=True, has_prior_error=True)
    return replace(run, **changes)


def write_folder(
    folder: Path, rows: tuple[FrameRow, ...] = FIVE_ROWS, with_truth: bool = True
) -> Path:
    """Write a results folder that holds just what the report reads."""
    columns = ["frame", "lat", "lon", "accepted", "reason", "prior_lat", "prior_lon"]
    errors = ["ce_m", "mace_m", "prior_ce_m"] if with_truth else []
    lines = [",".join(columns + errors)]
    for row in rows:
        estimate = ["24.0", "56.0"] if row.has_estimate else ["", ""]
        prior = ["24.1", "56.1"] if row.has_prior else ["", ""]
        cells = [row.frame, *estimate, str(row.accepted).lower(), row.reason, *prior]
        values = (getattr(row, name) for name in errors)
        cells += ["" if math.isnan(value) else f"{value:.3f}" for value in values]
        lines.append(",".join(cells))
    folder.mkdir(parents=True)
    (folder / "frames.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    record = {"version": "0.1.0", "counts": {"frames": len(rows)}}
    (folder / "run.json").write_text(json.dumps(record), encoding="utf-8")
    return folder
