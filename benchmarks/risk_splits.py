"""Are the promises of ``uasthn calibrate`` kept on frames it never saw? Over many random splits.

    python benchmarks/risk_splits.py RESULTS_DIR [RESULTS_DIR…] [--splits 200] [--by-flight]

A results folder is what ``uasthn geotag --truth`` wrote: nothing is predicted again.
"""

import csv
import io
import math
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import click
import numpy as np
from tables import markdown_table, number

from uasthn_cli.calibration.answers import Answers, IndexArray
from uasthn_cli.calibration.load import load_answers
from uasthn_cli.calibration.run import CalibrationSettings, acceptance_risks, judge
from uasthn_cli.config import CONFIDENCE_LEVEL, TARGET_RISK, TOLERANCE_M
from uasthn_cli.outputs.atomic import write_text
from uasthn_cli.types import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Split:
    """One split: calibrated on one part, judged on the other; NaN where nothing was accepted.

    ``ce90_coverage`` is over accepted frames, for which the scale is made; ``ce90_coverage_all``
    over all with an answer.
    """

    answers: str
    split: int
    calibration_frames: int
    test_frames: int
    certified: bool
    accepted: int
    errors: int
    accepted_fraction: float
    risk: float
    ce90_coverage: float
    ce90_coverage_all: float


def run_splits(
    answers: Answers, name: str, splits: int, settings: CalibrationSettings, by_flight: bool
) -> list[Split]:
    """Calibrate on a random half of the frames, or flights, and judge the other; many times."""
    rng = np.random.default_rng(settings.seed)
    found = []
    for k in range(splits):
        is_test = _random_half(answers.flight, rng, by_flight)
        own = replace(settings, seed=k)
        calibrated_on = answers.rows(~is_test)
        if not by_flight:
            calibrated_on = calibrated_on.as_one_flight()
        found.append(_judge_split(calibrated_on, answers.rows(is_test), name, k, own))
    return found


def as_markdown(results: list[Split], settings: CalibrationSettings, what: str) -> str:
    """Return a row per kind of answer, over all splits, and what was promised."""
    columns = (
        *("answers", "frames", "splits", "certified", "accepted", "risk mean", "risk 90 %"),
        *("splits above promise", "CE90 mean", "CE90 5 %", "CE90 95 %", "CE90 of all answers"),
    )
    kinds = list(dict.fromkeys(entry.answers for entry in results))
    rows = [_cells([e for e in results if e.answers == kind], settings) for kind in kinds]
    title = (
        f"Promised: at most {settings.target_risk:g} of accepted frames beyond"
        f" {settings.tolerance_m:g} m with confidence {settings.confidence_level:g}; CE90 covers"
        f" 0.90 of accepted frames. Half of the {what} calibrate, the other half judge."
    )
    return f"{title}\n\n{markdown_table(columns, rows)}\n"


def as_csv(results: list[Split]) -> str:
    """Return one row per kind of answer and split; what is not finite stays empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([field.name for field in fields(Split)])
    for entry in results:
        writer.writerow(_plain(value) for value in asdict(entry).values())
    return text.getvalue()


@click.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("--splits", type=click.IntRange(min=1), default=200, show_default=True)
@click.option("--risk", type=float, default=TARGET_RISK, show_default=True)
@click.option("--confidence", type=float, default=CONFIDENCE_LEVEL, show_default=True)
@click.option("--tolerance-m", type=float, default=TOLERANCE_M, show_default=True, metavar="M")
@click.option("--by-flight", is_flag=True, help="Leave flights out instead of frames.")
@click.option("--seed", type=int, default=0, show_default=True)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("out/benchmarks"),
    show_default=True,
    help="Folder for risk_splits.csv and risk_splits.md.",
)
def main(
    folders: tuple[Path, ...],
    splits: int,
    risk: float,
    confidence: float,
    tolerance_m: float,
    by_flight: bool,
    seed: int,
    out: Path,
) -> None:
    """Compare empirical with promised risk, and CE90 with its coverage."""
    if by_flight and len(folders) < 2:
        raise click.UsageError("--by-flight needs at least two results folders")
    settings = CalibrationSettings(tolerance_m, risk, confidence, seed)
    runs = load_answers(folders)
    kinds = {"single": runs.single, "fused": runs.fused}
    results = []
    for name, answers in kinds.items():
        if answers is not None:
            results += run_splits(answers, name, splits, settings, by_flight)
    table = as_markdown(results, settings, "flights" if by_flight else "frames")
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "risk_splits.csv", as_csv(results))
    write_text(out / "risk_splits.md", table)
    click.echo(table, nl=False)


def _random_half(flight: IndexArray, rng: np.random.Generator, by_flight: bool) -> BoolArray:
    """Tell which frames are in the half that judges."""
    if not by_flight:
        return rng.permutation(flight.size) < flight.size // 2
    flights = rng.permutation(np.unique(flight))
    return np.isin(flight, flights[: flights.size // 2])


def _judge_split(
    calibrated_on: Answers, test: Answers, name: str, split: int, settings: CalibrationSettings
) -> Split:
    judgement, refusal = judge(calibrated_on, settings)
    accepted = test.rows(acceptance_risks(judgement.model, test) <= judgement.max_risk)
    errors = int(accepted.is_error(settings.tolerance_m).sum())
    answered = test.rows(np.isfinite(test.error_m))
    return Split(
        answers=name,
        split=split,
        calibration_frames=len(calibrated_on),
        test_frames=len(test),
        certified=refusal is None,
        accepted=len(accepted),
        errors=errors,
        accepted_fraction=len(accepted) / len(test),
        risk=errors / len(accepted) if len(accepted) else math.nan,
        ce90_coverage=accepted.ce90_coverage(judgement.ce90_scale),
        ce90_coverage_all=answered.ce90_coverage(judgement.ce90_scale),
    )


def _cells(entries: list[Split], settings: CalibrationSettings) -> list[str]:
    """Return the figures of one kind of answer; a split that accepts nothing keeps its promise."""
    risk = _column(entries, "risk")
    coverage = _column(entries, "ce90_coverage")
    return [
        entries[0].answers,
        str(entries[0].calibration_frames + entries[0].test_frames),
        str(len(entries)),
        number(float(_column(entries, "certified").mean()), 2),
        number(float(_column(entries, "accepted_fraction").mean()), 3),
        number(_finite_mean(risk), 4),
        number(_finite_quantile(risk, 0.9), 4),
        number(float((risk > settings.target_risk).mean()), 3),
        number(_finite_mean(coverage), 3),
        number(_finite_quantile(coverage, 0.05), 3),
        number(_finite_quantile(coverage, 0.95), 3),
        number(_finite_mean(_column(entries, "ce90_coverage_all")), 3),
    ]


def _column(entries: list[Split], name: str) -> FloatArray:
    return np.array([getattr(entry, name) for entry in entries], dtype=np.float64)


def _finite_mean(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else math.nan


def _finite_quantile(values: FloatArray, quantile: float) -> float:
    finite = values[np.isfinite(values)]
    return float(np.quantile(finite, quantile)) if finite.size else math.nan


def _plain(value: object) -> object:
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else ""
    return value


if __name__ == "__main__":
    main()
