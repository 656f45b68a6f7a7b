"""How often frames are paired with the camera messages they belong to, refused, or paired wrong.

    python benchmarks/pairing.py [--mrk FILE]… [--frames FOLDER]… [--cases 240] [--seed 0]

Exposures are those of made-up surveys (steady, by distance with turns, by hand), and real ones: of
DJI's `.mrk` files and of frames that are named by their time. Of each case 0 to 20 % of the frames
and of the messages are lost, the camera's clock is wrong by -37 s to +3,600 s and drifts, and
frames tell their times exactly, in whole seconds, or only a number, which may have been given anew.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from tables import markdown_table

from uasthn_cli.ingest.frames import list_frames
from uasthn_cli.ingest.pairing import UnpairedError, pair_frames
from uasthn_cli.ingest.telemetry import CameraEvents, Stamps
from uasthn_cli.ingest.timestamps import time_in_name
from uasthn_cli.types import FloatArray, FrameFile

_START_S = 1_700_000_000.0
_CLOCKS_S = (0.0, 0.3, -37.0, 7.0, 900.0, 3600.0)
_LARGEST_LOSS = 0.2
_DRIFT_PPM = 60.0
_JITTER_S = 0.02
_WRONG_S = 0.5
"""A frame that keeps its own time is wrong by more than this."""

_NAMINGS = ("times", "whole seconds", "numbers", "numbers given anew")
_OUTCOMES = ("right", "refused", "wrong in silence")


@dataclass(frozen=True, slots=True)
class Case:
    """Exposures that left a file, those that left a message, and how the files are named."""

    series: str
    naming: str
    exposures_s: FloatArray
    files: list[int]
    kept: list[int]
    clock_s: float


def survey(kind: str, random: np.random.Generator) -> FloatArray:
    """Return the exposures of a made-up flight of 30 to 200 frames."""
    count = int(random.integers(30, 200))
    if kind == "steady":
        intervals_s = np.full(count, float(random.choice([1.0, 2.0, 3.0])))
    elif kind == "by hand":
        intervals_s = random.lognormal(np.log(4.0), 0.5, count)
    else:
        lane, wind = int(random.integers(8, 25)), random.uniform(0.05, 0.25)
        against = (np.arange(count) // lane) % 2 * 2 - 1
        intervals_s = 2.5 / (1.0 + wind * against) * random.normal(1.0, 0.01, count)
        intervals_s[lane::lane] += random.uniform(8.0, 15.0)
    return np.asarray(_START_S + np.cumsum(intervals_s) + random.normal(0.0, 0.005, count))


def read_mrk(path: Path) -> FloatArray:
    """Return the exposures of a DJI ``.mrk`` file: its second column, seconds of the GPS week."""
    rows = [line.split() for line in path.read_text().splitlines() if line.strip()]
    return np.array([_START_S + float(row[1]) for row in rows])


def read_names(folder: Path) -> FloatArray:
    """Return the times in the names of a folder's frames."""
    found = [time_in_name(Path(frame.name).stem) for frame in list_frames(folder)]
    return np.sort([stated.time_s for stated in found if stated is not None])


def draw_case(series: str, exposures_s: FloatArray, random: np.random.Generator) -> Case:
    """Lose frames and messages of a flight, and set its camera's clock wrong."""
    indices = np.arange(len(exposures_s))
    lost_files, lost_messages = random.uniform(0.0, _LARGEST_LOSS, 2) * random.integers(0, 2, 2)
    return Case(
        series=series,
        naming=str(random.choice(_NAMINGS)),
        exposures_s=exposures_s,
        files=indices[random.random(len(indices)) >= lost_files].tolist(),
        kept=indices[random.random(len(indices)) >= lost_messages].tolist(),
        clock_s=float(random.choice([*_CLOCKS_S, random.uniform(-37.0, 3600.0)])),
    )


def outcome(case: Case, random: np.random.Generator) -> str:
    """Pair the case and say what came of it."""
    taken_s = case.exposures_s[case.files]
    drift = 1e-6 * random.uniform(-_DRIFT_PPM, _DRIFT_PPM)
    own_s = taken_s - case.clock_s + drift * (taken_s - taken_s[0])
    stated_s = np.full(len(taken_s), np.nan)
    if case.naming == "times":
        stated_s = own_s
    elif case.naming == "whole seconds":
        stated_s = np.floor(own_s)
    is_new = case.naming == "numbers given anew"
    numbers: Sequence[int] = range(len(case.files)) if is_new else case.files
    frames = [FrameFile(f"{number + 1:05d}.png", Path("-")) for number in numbers]
    times_s = case.exposures_s[case.kept] + random.normal(0.0, _JITTER_S, len(case.kept))
    stamps = Stamps(np.arange(len(times_s)), times_s, np.full(len(times_s), np.nan))
    names = ("",) * len(times_s)
    events = CameraEvents(stamps, times_s, np.array(case.kept), names, "CAMERA_FEEDBACK")
    try:
        found = pair_frames(frames, stated_s, events, times_s)
    except UnpairedError:
        return "refused"
    if found is None:
        is_off = np.isfinite(stated_s).any() and abs(case.clock_s) > _WRONG_S
        return "wrong in silence" if is_off else "refused"
    pairs = zip(case.files, found.index.tolist(), strict=True)
    is_wrong = any(index >= 0 and case.kept[index] != number for number, index in pairs)
    return "wrong in silence" if is_wrong else "right"


@click.command()
@click.option("--mrk", "mrks", type=click.Path(exists=True, path_type=Path), multiple=True)
@click.option("--frames", "folders", type=click.Path(exists=True, path_type=Path), multiple=True)
@click.option("--cases", type=click.IntRange(min=1), default=240, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True)
def main(mrks: tuple[Path, ...], folders: tuple[Path, ...], cases: int, seed: int) -> None:
    """Count what becomes of many cases."""
    random = np.random.default_rng(seed)
    sources: list[tuple[str, Callable[[], FloatArray]]] = [
        (kind, lambda kind=kind: survey(kind, random))  # type: ignore[misc]
        for kind in ("steady", "by distance", "by hand")
    ]
    sources += [(path.name, lambda path=path: read_mrk(path)) for path in mrks]  # type: ignore[misc]
    sources += [
        (f"{path.parent.name}/{path.name}", lambda path=path: read_names(path))  # type: ignore[misc]
        for path in folders
    ]
    found: Counter[tuple[str, str, str]] = Counter()
    for number in range(cases):
        series, exposures = sources[number % len(sources)]
        case = draw_case(series, exposures(), random)
        found[case.series, case.naming, outcome(case, random)] += 1
    click.echo(markdown_table(("exposures", "frames tell", *_OUTCOMES), _rows(found)))


def _rows(found: Counter[tuple[str, str, str]]) -> list[list[str]]:
    kinds = sorted({key[:2] for key in found})
    rows = [[*kind, *(str(found[*kind, result]) for result in _OUTCOMES)] for kind in kinds]
    totals = [sum(found[*kind, result] for kind in kinds) for result in _OUTCOMES]
    return [*rows, ["all", "", *map(str, totals)]]


if __name__ == "__main__":
    main()
