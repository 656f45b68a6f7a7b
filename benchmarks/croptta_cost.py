"""What CropTTA costs the paper's networks on the CPU: N views against one, in one run.

    python benchmarks/croptta_cost.py [--weights FILE] [--views 5] [--threads 1]

Views share the satellite image's features; all else is the views' own. STHN's second stage looks at
the whole frame alone. "Plain" is one view by the same weights as the network is published: torch's
own pooling and normalisation, every place looked up by itself (`plain_ihn.py`; its answers are
compared). Without weights, those of the published size are random: cost does not depend on them.
Rounds alternate between all of these, and the smallest time of each counts, so that other load on
the machine weighs little.
"""

import time
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np
import torch
from plain_ihn import locate_plainly
from tables import machine_line, markdown_table, number, use_threads
from torch.utils.flop_counter import FlopCounterMode

from uasthn_cli.config import Sampling
from uasthn_cli.geometry.crops import crop_corners_px
from uasthn_cli.matching.displacement.agreement import EarlyStop, crop_agreement
from uasthn_cli.matching.displacement.checkpoints import load_displacement
from uasthn_cli.matching.displacement.ihn import IterativeHomographyNetwork
from uasthn_cli.matching.displacement.model import DisplacementModel
from uasthn_cli.matching.displacement.sthn import look_again
from uasthn_cli.matching.memory import keep_freed_memory

_OFFSET_PX = 16.0
"""The paper's 32 of 512 pixels, at W_R."""

_PLAIN, _ONE = "one view, plain", "one view"


def seconds(run: Callable[[], object]) -> float:
    """Return the wall-clock time of one call."""
    started_s = time.perf_counter()
    run()
    return time.perf_counter() - started_s


def operations(run: Callable[[], object]) -> int:
    """Return the additions and multiplications of convolutions and matrix products in one call."""
    with FlopCounterMode(display=False) as counter:
        run()
    return int(counter.get_total_flops())


def runs_of(model: DisplacementModel, views: int) -> dict[str, Callable[[], torch.Tensor]]:
    """Return what is timed: each finds the same thermal image in the same satellite image."""
    network, steps = model.network.eval(), model.settings.iterations
    map_square = torch.rand(1, 3, 1536, 1536)
    satellite, thermal = torch.rand(1, 3, 256, 256), torch.rand(1, 1, 256, 256).expand(1, 3, -1, -1)
    drawn = crop_corners_px(
        (256, 256), views, (_OFFSET_PX, _OFFSET_PX), Sampling.RANDOM, np.random.default_rng(0)
    )
    crops = torch.from_numpy(drawn).float()

    def with_second_stage(displacement: torch.Tensor) -> torch.Tensor:
        if model.second is None:
            return displacement
        return look_again(model.second, map_square, thermal, displacement).displacement

    def several(stop: EarlyStop | None) -> torch.Tensor:
        encoded = network.encode_satellite(satellite)
        agreed = crop_agreement(network, encoded, thermal, crops, steps, stop)
        return with_second_stage(agreed.original)

    runs: dict[str, Callable[[], torch.Tensor]] = {}
    if isinstance(network, IterativeHomographyNetwork) and model.second is None:
        runs[_PLAIN] = lambda: locate_plainly(network, satellite, thermal, steps)
    runs |= {
        "satellite features alone": lambda: network.encode_satellite(satellite),
        _ONE: lambda: with_second_stage(network(satellite, thermal, steps).last),
        f"{views} views": lambda: several(None),
    }
    if network.is_iterative:
        runs[f"{views} views, stopped after 3 steps"] = lambda: several(EarlyStop(3))
        runs[f"{views} views, stopped after 1 step"] = lambda: several(EarlyStop(1))
    return runs


@click.command()
@click.option("--weights", type=click.Path(exists=True, path_type=Path))
@click.option("--views", type=click.IntRange(min=2), default=5, show_default=True)
@click.option("--rounds", type=click.IntRange(min=1), default=5, show_default=True)
@click.option("--threads", type=click.IntRange(min=1), default=1, show_default=True)
@torch.inference_mode()
def main(weights: Path | None, views: int, rounds: int, threads: int) -> None:
    """Measure what CropTTA costs on the CPU."""
    use_threads(threads)
    keep_freed_memory()
    torch.manual_seed(0)
    model = (
        DisplacementModel(IterativeHomographyNetwork())
        if weights is None
        else load_displacement(weights)
    )
    runs = runs_of(model, views)
    best_s = dict.fromkeys(runs, float("inf"))
    for _ in range(rounds):
        for name, run in runs.items():
            best_s[name] = min(best_s[name], seconds(run))
    references = [name for name in (_PLAIN, _ONE) if name in runs]
    rows = [
        [name, number(operations(runs[name]) / 1e9, 1), number(1000.0 * taken_s, 0)]
        + [number(taken_s / best_s[reference], 2) for reference in references]
        for name, taken_s in best_s.items()
    ]
    header = [model.name, "GFLOP", "ms", *(f"× {reference}" for reference in references)]
    click.echo(markdown_table(header, rows))
    if _PLAIN in runs:
        difference = (runs[_PLAIN]() - runs[_ONE]()).abs().max()
        click.echo(f"largest difference of plain and ours: {float(difference):.1e} px")
    click.echo(machine_line(threads))


if __name__ == "__main__":
    main()
