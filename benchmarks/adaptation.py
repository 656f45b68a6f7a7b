"""Does fine-tuning on the very map of a flight help? Figures of some recipes, on held real frames.

    python benchmarks/adaptation.py --map ../shared/flights/dunes_east/map.tif --out out/adaptation

No thermal frame is used: what a camera would see is rendered from the map. Frames over the adapted
map say what a recipe gains, the others what it costs.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import click
import torch
from ablation import COLUMNS, FRAMES, cells, read_scores, slug, summarise
from held import evaluate
from tables import markdown_table, use_threads
from torch import nn

from uasthn_cli.config import Precision
from uasthn_cli.matching.memory import keep_freed_memory
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.registry import XCORR
from uasthn_cli.matching.torch_weights import serialise_xcorr
from uasthn_cli.outputs.atomic import write_bytes, write_text
from uasthn_cli.training.loop import train_steps
from uasthn_cli.training.losses import window_statistics
from uasthn_cli.training.precision import use_bfloat16
from uasthn_cli.training.samples import SampleConfig, SampleDataset
from uasthn_cli.training.scenes import RenderedShares, load_scenes
from uasthn_cli.training.trainee import TrainingConfig, open_trainee, read_initial_weights

_STATISTICS_BATCHES = 12


def _all(_: XcorrModel) -> None:
    """Train everything."""


def _satellite_encoder(model: XcorrModel) -> None:
    """Leave the thermal encoder as it is."""
    model.thermal_encoder.requires_grad_(False).eval()


def _affine(model: XcorrModel) -> None:
    """Train scales and offsets of batch norm alone; its statistics stay."""
    model.requires_grad_(False).eval()
    for module in model.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.requires_grad_(True)


@dataclass(frozen=True, slots=True)
class Recipe:
    """What is trained, how fast, and how much of what it sees is rendered and not of the map."""

    freeze: Callable[[XcorrModel], None]
    learning_rate: float
    rendered: RenderedShares


_HALF = RenderedShares(0.2, 0.3)
STATISTICS = "batch-norm statistics of the map"
RECIPES: dict[str, Recipe | None] = {
    STATISTICS: None,
    "map and rendered, all": Recipe(_all, 3e-4, _HALF),
    "map and rendered, satellite encoder": Recipe(_satellite_encoder, 3e-4, _HALF),
    "map only, affine": Recipe(_affine, 1e-3, RenderedShares(0.0, 0.0)),
}


def adapted(
    weights: Path, map_path: Path, recipe: Recipe | None, steps: int, scratch: Path
) -> XcorrModel:
    """Return the weights after fine-tuning on a map; without a recipe, new statistics only."""
    initial = read_initial_weights(weights)
    if recipe is None:
        return _with_statistics_of(initial.model, map_path)
    config = TrainingConfig(
        steps=steps,
        learning_rate=recipe.learning_rate,
        workers=0,
        bfloat16=use_bfloat16(Precision.AUTO, "cpu"),
        samples=SampleConfig(windows=4),
        architecture=initial.model.architecture,
    )
    scenes = load_scenes([(str(map_path), 1.0)], recipe.rendered)
    trainee = open_trainee(config, scratch, scenes.fingerprint(), initial)
    recipe.freeze(trainee.model)
    for progress in train_steps(trainee, scenes, config, scratch):
        click.echo(f"step {progress.step}: loss {progress.loss:.3f}", err=True)
    scratch.unlink()
    return trainee.model.eval()


@torch.no_grad()
def _with_statistics_of(model: XcorrModel, map_path: Path) -> XcorrModel:
    """Return the model with the satellite encoder's statistics taken from windows of a map."""
    scenes = load_scenes([(str(map_path), 1.0)], RenderedShares(0.0, 0.0))
    dataset = SampleDataset(
        scenes, SampleConfig(windows=8, canvases=1), seed=0, batches=_STATISTICS_BATCHES
    )
    for module in model.satellite_encoder.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.reset_running_stats()
            module.momentum = None  # a plain mean over all batches
            module.train()
    for index in range(_STATISTICS_BATCHES):
        batch = dataset[index]
        satellite, valid = map(torch.from_numpy, (batch.satellite, batch.satellite_valid))
        model.encode_satellite(satellite, valid, *window_statistics(satellite, valid))
    return model.eval()


@click.command()
@click.option("--map", "map_path", type=click.Path(exists=True, path_type=Path), required=True)
@click.option(
    "--shared",
    type=click.Path(path_type=Path),
    default=Path(__file__).resolve().parents[2] / "shared",
    show_default=True,
    help="Folder with flights/ and pairs/.",
)
@click.option("--weights", type=click.Path(path_type=Path), default=XCORR.bundled_weights[0])
@click.option("--out", type=click.Path(path_type=Path), required=True)
@click.option("--steps", type=click.IntRange(min=1), default=120, show_default=True)
@click.option("--recipe", "names", multiple=True, type=click.Choice(list(RECIPES)))
def main(
    map_path: Path, shared: Path, weights: Path, out: Path, steps: int, names: tuple[str, ...]
) -> None:
    """Adapt by each recipe, evaluate, and print a table with the weights as they were on top."""
    use_threads(1)
    keep_freed_memory()
    out.mkdir(parents=True, exist_ok=True)
    before = "as they were"
    for name in (before, *(names or RECIPES)):
        path = out / f"{slug(name)}.json"
        if path.exists():
            continue
        click.echo(name, err=True)
        if name == before:
            model = read_initial_weights(weights).model
        else:
            scratch = out / "scratch.checkpoint.pt"
            model = adapted(weights, map_path, RECIPES[name], steps, scratch)
            write_bytes(path.with_suffix(".safetensors"), serialise_xcorr(model, {}))
        scores = {k: [asdict(s) for s in rows] for k, rows in evaluate(model, shared).items()}
        write_text(path, json.dumps({"recipe": name, "scores": scores}, indent=1) + "\n")
    _print_table(out, (before, *RECIPES))


def _print_table(out: Path, names: tuple[str, ...]) -> None:
    files = {name: out / f"{slug(name)}.json" for name in names}
    scores = {name: read_scores(path) for name, path in files.items() if path.exists()}
    for frames in FRAMES:
        rows = [[name, *cells(summarise(own[frames]))] for name, own in scores.items()]
        click.echo(f"**{frames}**\n\n{markdown_table(('weights', *COLUMNS), rows)}\n")


if __name__ == "__main__":
    main()
