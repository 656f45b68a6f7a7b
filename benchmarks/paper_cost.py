"""Let the paper's network find so many random frames: what `speed.py` runs as a process of its own.

    python benchmarks/paper_cost.py RUN VIEWS FRAMES

RUN is a row of `croptta_cost.py` (``one view, plain``, ``one view``, ``5 views``), or several views
as published, one by one (``5 views, plain``): ``ihn`` of the published size with random weights.
"""

import sys

import torch
from croptta_cost import runs_of
from tables import use_threads

from uasthn_cli.matching.displacement.ihn import IterativeHomographyNetwork
from uasthn_cli.matching.displacement.model import DisplacementModel
from uasthn_cli.matching.memory import keep_freed_memory


@torch.inference_mode()
def main(run: str, views: str, frames: str) -> None:
    """Run one of the formulations once for each frame."""
    use_threads(1)
    keep_freed_memory()
    torch.manual_seed(0)
    runs = runs_of(DisplacementModel(IterativeHomographyNetwork()), int(views))
    one_by_one = run == f"{views} views, plain"
    find = runs["one view, plain" if one_by_one else run]
    for _ in range(int(frames) * (int(views) if one_by_one else 1)):
        find()


if __name__ == "__main__":
    main(*sys.argv[1:])
