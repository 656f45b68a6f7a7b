"""What each part of the data engine and of the training data is worth, on held real pixels.

    python benchmarks/ablation.py --shared ../shared --out out/ablation [--steps N] [--arm NAME …]
    python benchmarks/ablation.py --table-only --out out/ablation

Every arm trains the same small network from the same random weights for the same number of steps;
the seeds of the full recipe say how far two runs differ by chance. An arm whose scores lie in the
output folder is not trained again, one that was interrupted goes on from its checkpoint.
"""

import json
import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np
from held import FLIGHTS, PAIR, FrameScore, evaluate
from tables import markdown_table, number, use_threads

from uasthn_cli.config import TOLERANCE_M, Precision
from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.matching.memory import keep_freed_memory
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.torch_weights import serialise_xcorr
from uasthn_cli.outputs.atomic import write_bytes, write_text
from uasthn_cli.training.engine import engine_without
from uasthn_cli.training.loop import train_steps
from uasthn_cli.training.precision import use_bfloat16
from uasthn_cli.training.samples import SampleConfig
from uasthn_cli.training.scenes import RenderedShares, load_scenes
from uasthn_cli.training.trainee import Trainee, TrainingConfig, open_trainee

ARCHITECTURE = XcorrArchitecture(16, (16, 32, 48, 64))
WINDOWS = 5
NAIP = (("naip/*.tif", 1.5),)
RESEARCH = (
    ("research/aid_desert/*", 1.2),
    ("research/aid_bareland/*", 1.0),
    ("research/finland/*", 0.8),
    ("research/newyork/*", 1.3),
    ("research/roads/*", 1.3),
    ("research/rsscn7/*", 2.0),
)
FRAMES = (*(flight for flight, _, _ in FLIGHTS), PAIR)
COLUMNS = (
    *("median CE m", "90 % CE m", "within 25 m"),
    *("their median CE m", "their east m", "their north m", "log posterior"),
)
_FULL = "full recipe"


@dataclass(frozen=True, slots=True)
class Arm:
    """A recipe: parts of the engine that are off, imagery by pattern and weight, shares, seed."""

    without: tuple[str, ...] = ()
    imagery: tuple[tuple[str, float], ...] = NAIP + RESEARCH
    rendered: RenderedShares = field(default_factory=lambda: RenderedShares(0.18, 0.28))
    seed: int = 0


ARMS: dict[str, Arm] = {
    f"{_FULL}, seed 0": Arm(),
    "NAIP and rendered, as trained clean": Arm(imagery=NAIP, rendered=RenderedShares(0.22, 0.5)),
    "without relief": Arm(without=("relief",)),
    f"{_FULL}, seed 1": Arm(seed=1),
    "without sand": Arm(rendered=RenderedShares(0.0, 0.28)),
    "without landscapes": Arm(rendered=RenderedShares(0.18, 0.0)),
    "without tone-curves": Arm(without=("tone-curves",)),
    "without cluster-temperatures": Arm(without=("cluster-temperatures",)),
    "without texture": Arm(without=("texture",)),
    "without sensor": Arm(without=("sensor",)),
    "without date-change": Arm(without=("date-change",)),
    "without geometry-error": Arm(without=("geometry-error",)),
    f"{_FULL}, seed 2": Arm(seed=2),
    "without research imagery": Arm(imagery=NAIP),
    "rendered only": Arm(imagery=(), rendered=RenderedShares(0.4, 0.6)),
    "without map-appearance": Arm(without=("map-appearance",)),
    "without scale-range": Arm(without=("scale-range",)),
}
"""By importance; the last one last, because it renders all landscapes anew."""


@dataclass(frozen=True, slots=True)
class Summary:
    """One arm on one set of frames; ``hit_*`` are medians of the frames within 25 m."""

    ce_median_m: float
    ce_p90_m: float
    within_25m: float
    hit_ce_median_m: float
    hit_east_median_m: float
    hit_north_median_m: float
    log_posterior: float


def slug(name: str) -> str:
    """Return an arm's file name."""
    return name.replace(",", "").replace(" ", "-")


def summarise(scores: list[FrameScore]) -> Summary:
    """Return the figures of a set of frames."""
    ce_m = np.array([score.ce_m for score in scores])
    hits_m = np.array([(s.ce_m, s.east_m, s.north_m) for s in scores if s.ce_m <= TOLERANCE_M])
    hit_medians_m = np.median(hits_m, axis=0) if len(hits_m) else np.full(3, math.nan)
    return Summary(
        ce_median_m=float(np.median(ce_m)),
        ce_p90_m=float(np.quantile(ce_m, 0.9)),
        within_25m=float(np.mean(ce_m <= TOLERANCE_M)),
        hit_ce_median_m=float(hit_medians_m[0]),
        hit_east_median_m=float(hit_medians_m[1]),
        hit_north_median_m=float(hit_medians_m[2]),
        log_posterior=float(np.mean([score.log_posterior for score in scores])),
    )


def read_scores(path: Path) -> dict[str, list[FrameScore]]:
    """Read an arm's scores by set of frames."""
    content = json.loads(path.read_text("utf-8"))
    return {name: [FrameScore(**row) for row in rows] for name, rows in content["scores"].items()}


def table(out: Path) -> str:
    """Return a Markdown table per set of frames, of the arms that are finished."""
    finished = {
        name: read_scores(path) for name in ARMS if (path := out / f"{slug(name)}.json").exists()
    }
    parts = []
    for frames in FRAMES:
        own = {name: summarise(scores[frames]) for name, scores in finished.items()}
        rows = [[name, *cells(summary)] for name, summary in own.items()]
        seeds = [summary for name, summary in own.items() if name.startswith(_FULL)]
        if len(seeds) > 1:
            rows += [[f"{_FULL}: {label}", *figures] for label, figures in _spread(seeds)]
        parts += [f"**{frames}**", markdown_table(("arm", *COLUMNS), rows)]
    return "\n\n".join(parts) + "\n"


def _spread(seeds: list[Summary]) -> Iterator[tuple[str, list[str]]]:
    """Yield mean and standard deviation over the seeds of the full recipe."""
    values = np.array([list(asdict(summary).values()) for summary in seeds])
    yield f"mean of {len(seeds)}", cells(Summary(*map(float, values.mean(axis=0))))
    yield "deviation", cells(Summary(*map(float, values.std(axis=0, ddof=1))))


def cells(summary: Summary) -> list[str]:
    """Return what stands under :data:`COLUMNS`."""
    return [
        number(summary.ce_median_m, 1),
        number(summary.ce_p90_m, 0),
        number(summary.within_25m, 2),
        number(summary.hit_ce_median_m, 1),
        number(summary.hit_east_median_m, 1),
        number(summary.hit_north_median_m, 1),
        number(summary.log_posterior, 2),
    ]


def _train(arm: Arm, name: str, shared: Path, out: Path, steps: int) -> Trainee[XcorrModel]:
    config = TrainingConfig(
        steps=steps,
        seed=arm.seed,
        workers=0,
        bfloat16=use_bfloat16(Precision.AUTO, "cpu"),
        samples=SampleConfig(windows=WINDOWS, engine=engine_without(arm.without)),
        architecture=ARCHITECTURE,
    )
    patterns = [(str(shared / "imagery" / pattern), weight) for pattern, weight in arm.imagery]
    scenes = load_scenes(patterns, arm.rendered)
    checkpoint = out / f"{slug(name)}.checkpoint.pt"
    trainee = open_trainee(config, checkpoint, scenes.fingerprint())
    for progress in train_steps(trainee, scenes, config, checkpoint):
        click.echo(
            f"{name}: step {progress.step} of {steps}, {progress.seconds:.0f} s, loss"
            f" {progress.loss:.3f}, {progress.within_4_px:.0%} within 4 px",
            err=True,
        )
    return trainee


def _run(name: str, shared: Path, out: Path, steps: int) -> None:
    """Train and evaluate one arm; its scores are the last file that it writes."""
    started_s = time.monotonic()
    trainee = _train(ARMS[name], name, shared, out, steps)
    model = trainee.model.eval()
    write_bytes(out / f"{slug(name)}.safetensors", serialise_xcorr(model, {"arm": name}))
    content: dict[str, Any] = {
        "arm": name,
        "steps": steps,
        "seconds": round(time.monotonic() - started_s),
        "scores": {
            frames: [asdict(score) for score in scores]
            for frames, scores in evaluate(model, shared).items()
        },
    }
    write_text(out / f"{slug(name)}.json", json.dumps(content, indent=1) + "\n")
    (out / f"{slug(name)}.checkpoint.pt").unlink()


@click.command()
@click.option(
    "--shared",
    type=click.Path(path_type=Path),
    default=Path(__file__).resolve().parents[2] / "shared",
    show_default=True,
    help="Folder with imagery/, flights/ and pairs/.",
)
@click.option("--out", type=click.Path(path_type=Path), required=True)
@click.option("--steps", type=click.IntRange(min=1), default=200, show_default=True)
@click.option("--arm", "names", multiple=True, type=click.Choice(list(ARMS)), help="All if none.")
@click.option("--threads", type=int, default=1, show_default=True)
@click.option("--table-only", is_flag=True, help="Only the table of what is finished.")
def main(
    shared: Path, out: Path, steps: int, names: tuple[str, ...], threads: int, table_only: bool
) -> None:
    """Train, evaluate and tabulate arms."""
    use_threads(threads)
    keep_freed_memory()
    out.mkdir(parents=True, exist_ok=True)
    for name in () if table_only else names or tuple(ARMS):
        if (out / f"{slug(name)}.json").exists():
            click.echo(f"{name}: finished before", err=True)
            continue
        _run(name, shared, out, steps)
        write_text(out / "ablation.md", table(out))
    click.echo(table(out), nl=False)


if __name__ == "__main__":
    main()
