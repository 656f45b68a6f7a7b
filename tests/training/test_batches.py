"""Rendering ahead in other processes: the same batches in the same order, and no process left."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest
from tiny_training import TINY_SAMPLES, pattern_scenes

from uasthn_cli.training.batches import load_batches
from uasthn_cli.training.samples import Batch, SampleDataset

SUPPORT = Path(__file__).parents[1] / "support"

PARENT = """
import multiprocessing, sys, time
sys.path.insert(0, sys.argv[1])
from tiny_training import TINY_SAMPLES, pattern_scenes
from uasthn_cli.training.batches import load_batches
from uasthn_cli.training.samples import SampleDataset
batches = load_batches(SampleDataset(pattern_scenes(), TINY_SAMPLES, seed=0, batches=50), workers=2)
next(batches)
print(*(child.pid for child in multiprocessing.active_children()), flush=True)
time.sleep(600)
"""


def same(a: Batch, b: Batch) -> bool:
    return all(map(np.array_equal, astuple(a), astuple(b)))


@pytest.mark.slow
def test_workers_render_the_same_batches_in_order() -> None:
    dataset = SampleDataset(pattern_scenes(), TINY_SAMPLES, seed=1, batches=5)
    alone = list(load_batches(dataset, workers=0, start=1))
    helped = list(load_batches(dataset, workers=2, start=1))
    assert len(alone) == 4
    assert all(map(same, alone, helped))
    assert same(alone[0], dataset[1])


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_workers_of_a_killed_run_do_not_stay() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, str(SUPPORT)], stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        workers = [int(pid) for pid in parent.stdout.readline().split()]
        assert len(workers) == 2
        assert all(map(is_running, workers))
        parent.send_signal(signal.SIGKILL)
    for _ in range(600):
        if not any(map(is_running, workers)):
            return
        time.sleep(0.1)
    for pid in filter(is_running, workers):
        os.kill(pid, signal.SIGKILL)
    pytest.fail("a worker outlived the process it worked for")
