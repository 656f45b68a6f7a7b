"""Tables in Markdown, and a line about the machine they were made on."""

import math
import os
import platform
from collections.abc import Sequence
from pathlib import Path

import cv2
import torch


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table, first column to the left, others to the right."""
    widths = [max(len(cell) for cell in column) for column in zip(columns, *rows, strict=True)]
    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    return "\n".join(_line(cells, widths) for cells in (columns, rule, *rows))


def number(value: float | None, digits: int) -> str:
    """Return a number with so many digits after the point; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:.{digits}f}"


def use_threads(count: int) -> None:
    """Let OpenCV and PyTorch use this many threads each."""
    cv2.setNumThreads(count)
    torch.set_num_threads(count)


def machine_line(threads: int) -> str:
    """Return what figures depend on: processor, cores, threads, versions."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    versions = (
        f"Python {platform.python_version()}, torch {torch.__version__}, OpenCV {cv2.__version__}"
    )
    return f"{_processor()}, {cores} cores, {threads} threads, {_load()}; {versions}"


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    first, *others = zip(cells, widths, strict=True)
    padded = [first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in others)]
    return f"| {' | '.join(padded)} |"


def _processor() -> str:
    """Return the processor's name, as Linux tells it where it does."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _load() -> str:
    """Return how busy the machine was in the last minute, this process included."""
    return f"load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "load unknown"
