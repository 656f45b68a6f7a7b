"""Batches rendered ahead in worker processes, in a fixed order."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from typing import Any, Protocol, TypeVar, cast

import cv2
from torch.utils.data import DataLoader, Dataset

_AHEAD = 4
_LOOK_EVERY_S = 1.0

BatchT = TypeVar("BatchT")
BatchT_co = TypeVar("BatchT_co", covariant=True)


class NumberedBatches(Protocol[BatchT_co]):
    """Batches by number: the same number gives the same batch in any worker."""

    def __len__(self) -> int:
        """Return the number of batches."""

    def __getitem__(self, index: int, /) -> BatchT_co:
        """Return a batch."""


def load_batches(
    dataset: NumberedBatches[BatchT], workers: int, start: int = 0
) -> Iterator[BatchT]:
    """Return batches from number ``start`` on; 0 workers render in this process."""
    cv2.setNumThreads(1)  # a pool of threads that is forked never answers: end it before
    loader: DataLoader[BatchT] = DataLoader(
        cast("Dataset[BatchT]", dataset),
        batch_size=None,
        sampler=range(start, len(dataset)),
        num_workers=workers,
        collate_fn=_identity,
        worker_init_fn=_prepare_worker,
        prefetch_factor=_AHEAD if workers else None,
    )
    return iter(loader)


def _identity(batch: Any) -> Any:
    return batch


def _prepare_worker(_: int) -> None:
    """Leave Ctrl-C to the main process and the other cores to the network; end with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when its parent is gone.

    A parent that is killed cannot say so, and PyTorch's own watch is of no use to a worker that
    waits for room in a full pipe which nobody reads any more.
    """
    parent = multiprocessing.parent_process()
    while parent is not None and os.getppid() == parent.pid:
        time.sleep(_LOOK_EVERY_S)
    os._exit(1)
