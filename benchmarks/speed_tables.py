"""The tables of `speed.py`: what processes took, and where runs spent it."""

import csv
import io
import math
from collections.abc import Iterator, Sequence

from speed_cases import BEFORE
from speed_figures import OTHER, OUTSIDE, Figures
from tables import machine_line, markdown_table, number

from uasthn_cli.version import code_version

_STAGES = ("log", "decode", "rectify", "map", "features", "search", "fuse", "write")
_COLUMNS = (
    *("run", "CPU s", "median", "wall s", "median wall", "CPU ms/frame", "wall ms/frame"),
    *("CPU ms/further frame", "wall ms/further frame", "peak MiB"),
    *("before / CPU", "before / further CPU"),
)
_START_COLUMNS = (
    *("run", "CPU s", "median", "wall s", "median wall", "peak MiB"),
    *("CPU s without log and map", "wall s without log and map"),
)
_HOW = (
    "CPU is user and system time of the whole process, start-up and imports included: the smallest"
    " of all repetitions (per frame too) and their median. A further frame is what each frame after"
    " the first takes: the flight less a run over its middle frame alone, which is start-up, log,"
    " and the first piece of map. Stages are seconds on the clock, those of all threads together."
)


def as_markdown(found: Sequence[Figures], threads: int) -> str:
    """Return all tables, what was left out, and a line about the machine."""
    parts = [_HOW]
    for table in dict.fromkeys(figures.case.table for figures in found):
        rows = [one for one in found if one.case.table == table and one.error is None]
        if rows:
            parts += [f"**{table}**", *_tables(rows)]
    parts += [
        f"Left out: {one.case.table}, {one.case.name}: {one.error}" for one in found if one.error
    ]
    return "\n\n".join([*parts, _versions(found), machine_line(threads)]) + "\n"


def as_csv(found: Sequence[Figures]) -> str:
    """Return a line for each case that ran; what is not known stays empty."""
    lines: list[dict[str, object]] = []
    for one in (figures for figures in found if figures.error is None):
        case, stages = one.case, one.best.stage_s
        named = {"group": case.group, "table": case.table, "run": case.name, "frames": case.count}
        times = one.row() | {"times_before": _ratio(found, one, "cpu_ms_frame")}
        times |= {"times_before_further": _ratio(found, one, "cpu_ms_further_frame")}
        staged = {f"{name}_s": stages.get(name, math.nan) for name in (*_STAGES, OTHER, OUTSIDE)}
        figures = {name: _plain(value) for name, value in (times | staged).items()}
        lines.append({**named, "repeats": len(one.whole), **figures})
    text = io.StringIO()
    writer = csv.DictWriter(text, list(lines[0]) if lines else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return text.getvalue()


def _tables(rows: Sequence[Figures]) -> Iterator[str]:
    """Yield the table of one heading's rows, and one by stage where rows are of a flight."""
    if rows[0].case.group == "start":
        yield markdown_table(_START_COLUMNS, [_start_cells(one) for one in rows])
        return
    yield markdown_table(_COLUMNS, [_cells(rows, one) for one in rows])
    staged = [one for one in rows if one.case.geotags]
    if staged:
        yield _stage_table(staged)


def _cells(rows: Sequence[Figures], one: Figures) -> list[str]:
    row = one.row()
    seconds = [number(row[f"{kind}_{of}_s"], 2) for kind in ("cpu", "wall") for of in _MIN_MEDIAN]
    frames = [
        number(row[f"{kind}_ms_{of}"], 1)
        for of in ("frame", "further_frame")
        for kind in ("cpu", "wall")
    ]
    ratios = [_ratio(rows, one, f"cpu_ms_{of}") for of in ("frame", "further_frame")]
    return [
        *(one.case.name, *seconds, *frames),
        *(number(row["peak_mib"], 0), *(number(ratio, 1) for ratio in ratios)),
    ]


_MIN_MEDIAN = ("min", "median")


def _ratio(found: Sequence[Figures], one: Figures, name: str) -> float:
    """Return how many times as much the older version took on the same flight."""
    before = [
        other
        for other in found
        if other.case.group == BEFORE and other.case.table == one.case.table and not other.error
    ]
    return before[0].row()[name] / one.row()[name] if before else math.nan


def _start_cells(one: Figures) -> list[str]:
    row = one.row()
    seconds = [number(row[f"{kind}_{of}_s"], 2) for kind in ("cpu", "wall") for of in _MIN_MEDIAN]
    beyond = [math.nan, math.nan]
    if one.case.geotags:
        read_s = [sample.stage_s["log"] + sample.stage_s["map"] for sample in one.whole]
        beyond = [
            min(taken - own for taken, own in zip(times, read_s, strict=True))
            for times in (one.cpu_s, one.wall_s)
        ]
    return [one.case.name, *seconds, number(row["peak_mib"], 0), *(number(s, 2) for s in beyond)]


def _stage_table(rows: Sequence[Figures]) -> str:
    """Return milliseconds a frame by stage, of each run's best repetition."""
    lines = [
        [stage, *(number(_stage_ms(one, stage), 1) for one in rows)]
        for stage in (*_STAGES, OTHER, OUTSIDE)
    ]
    return markdown_table(["ms/frame", *(one.case.name for one in rows)], lines)


def _stage_ms(one: Figures, stage: str) -> float:
    """Return a stage's share; none where threads ran at the same time and nothing is left over."""
    seconds = one.best.stage_s.get(stage, 0.0)
    return math.nan if seconds < 0.0 else 1e3 * seconds / one.case.count


def _versions(found: Sequence[Figures]) -> str:
    """Return which code was measured, as the runs themselves say it."""
    older = {one.best.version for one in found if one.case.group == BEFORE and one.whole}
    known = sorted(version for version in older if version)
    before = f"before: {', '.join(known)}; " if known else ""
    return f"{before}after: {code_version()}"


def _plain(value: float) -> object:
    return round(value, 4) if math.isfinite(value) else ""
