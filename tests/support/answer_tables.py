"""Synthetic answers whose true risk is known, as arrays and as results folders."""

import csv
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from uasthn_cli.calibration.answers import Answers
from uasthn_cli.types import FloatArray

FIRST_FRAME_UTC_S = 1_763_800_000


def make_answers(
    count: int, seed: int, *, flight: int = 0, wrong: float = 0.25, agreement: bool = False
) -> Answers:
    """Return answers of which about a share ``wrong`` is far off, as their signals half tell.

    A right answer's error is Rayleigh with a 90 % radius of 1.5 times ``ce90_m``; a wrong one's
    lies anywhere between 25 and 400 m.
    """
    rng = np.random.default_rng(seed)
    hardness = rng.normal(size=count)
    offset = np.log(wrong / (1 - wrong)) * 1.6
    is_wrong = rng.random(count) < 1 / (1 + np.exp(-(2.5 * hardness + offset)))
    sigma_m = np.exp(1.5 + 0.6 * hardness + 0.2 * rng.normal(size=count))
    ce90_m = 3 + 2 * rng.random(count)
    right_m = 1.5 * ce90_m * rng.rayleigh(size=count) / np.sqrt(2 * np.log(10))
    signals = {
        "confidence": 1 / (1 + np.exp(1.2 * hardness - 1 + 0.5 * rng.normal(size=count))),
        "entropy": np.maximum(4 + hardness + 0.5 * rng.normal(size=count), 0.0),
        "sigma_m": sigma_m,
        "u_m": np.exp(1 + 0.5 * hardness + 0.8 * rng.normal(size=count)),
        "agreement_m": np.full(count, np.nan),
        "support": np.full(count, np.nan),
    }
    if agreement:
        signals["agreement_m"] = np.where(is_wrong, 60.0, 8.0) * np.exp(rng.normal(size=count))
        agreeing = rng.binomial(9, np.where(is_wrong, 0.3, 0.9))
        signals["support"] = agreeing / 9
    return Answers(
        flight=np.full(count, flight, dtype=np.intp),
        error_m=np.where(is_wrong, rng.uniform(25.5, 400, count), np.minimum(right_m, 24.0)),
        acceptable=np.ones(count, dtype=np.bool_),
        ce90_m=ce90_m,
        map_ce90_m=np.zeros(count),
        signals=signals,
    )


def answer_cells(answers: Answers, prefix: str = "") -> list[dict[str, str]]:
    """Return the cells of each frame's answer as ``uasthn geotag --truth`` writes them."""
    columns: dict[str, FloatArray] = {
        "ce_m": answers.error_m,
        "offset_m": answers.error_m,
        "ce90_m": answers.ce90_m,
        **answers.signals,
    }
    return [
        {
            f"{prefix}center_lat": "24.0" if np.isfinite(answers.error_m[k]) else "",
            f"{prefix}accepted": "true" if answers.acceptable[k] else "false",
            f"{prefix}reason": "" if answers.acceptable[k] else "implausible-scale",
            **{prefix + name: _cell(values[k]) for name, values in columns.items()},
        }
        for k in range(len(answers))
    ]


def write_results(
    folder: Path,
    answers: Answers,
    single: Answers | None = None,
    record: Mapping[str, object] | None = None,
) -> Path:
    """Write a results folder; ``single`` makes it one with fused answers. A frame a second."""
    rows = answer_cells(answers)
    extra = answer_cells(single, "single_") if single is not None else [{} for _ in rows]
    for k, (row, more) in enumerate(zip(rows, extra, strict=True)):
        moment = np.datetime64(FIRST_FRAME_UTC_S + k, "s")
        common = {
            "frame": f"{k:05d}.png",
            "time_utc": f"{moment}.000Z",
            "lat": row["center_lat"],
            "lon": "56.0" if row["center_lat"] else "",
            "prior_lat": "24.1",
            "prior_lon": "56.1",
            "mace_m": row["ce_m"],
            "source": "fix" if single is None else "fused",
        }
        rows[k] = row | more | common
    write_rows(folder, rows, record)
    return folder


def write_rows(
    folder: Path, rows: list[dict[str, str]], record: Mapping[str, object] | None = None
) -> None:
    """Write a results folder from cells."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "frames.csv").open("w", encoding="utf-8", newline="") as handle:
        writer = csv.DictWriter(handle, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    whole = {"version": "0.1.0", "counts": {"frames": len(rows)}, **(record or {})}
    (folder / "run.json").write_text(json.dumps(whole), encoding="utf-8")


def _cell(value: float) -> str:
    return f"{value:.4f}" if np.isfinite(value) else ""
