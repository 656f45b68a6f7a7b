"""What `speed.py` runs: each case is a command line, of a whole flight and of one frame of it."""

import importlib.util
import os
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from speed_inputs import Flight, in_huge_map, one_frame, rendered_flight

from uasthn_cli.config import CropTtaConfig

_HERE: Final = Path(__file__).parent.absolute()

BEFORE: Final = "before"
GROUPS: Final = (
    *("floor", BEFORE, "after", "jobs", "crops", "paper"),
    *("reach", "flat", "big-map", "start"),
)

_START: Final = "Start"


class Cache(StrEnum):
    """What a run finds of the map's features: told by ``--cache``, if the version knows it."""

    UNKNOWN = "unknown"
    NONE = "none"
    EMPTY = "empty"
    KEPT = "kept"


@dataclass(frozen=True, slots=True)
class Tool:
    """An installed ``uasthn``: how it is started, and in what environment."""

    command: tuple[str, ...]
    environment: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Case:
    """One row: a command for so many frames, of ``flight`` if there is one.

    With ``geotags`` the flight's arguments and ``extra`` follow the tool's command; in any other
    command ``{log}``, ``{frames}`` and ``{count}`` stand for the flight's. ``table`` is the heading
    under which the row is shown.
    """

    group: str
    name: str
    table: str
    tool: Tool
    count: int = 1
    flight: Flight | None = None
    geotags: bool = False
    cache: Cache = Cache.UNKNOWN
    extra: tuple[str, ...] = ()

    def arguments(self, flight: Flight | None, count: int, out: Path, cache: Path) -> list[str]:
        """Return the command line for the case's flight, or for ``count`` frames of it."""
        if not self.geotags or flight is None:
            paths = {} if flight is None else {"log": flight.log, "frames": flight.frames}
            return [part.format(count=count, **paths) for part in self.tool.command]
        line = [*self.tool.command, "geotag", str(flight.log), str(flight.frames)]
        line += ["--map", str(flight.map), "--out", str(out), "--hfov", f"{flight.hfov_deg:g}"]
        line += ["--search-radius", f"{flight.radius_m:g}", *self.extra]
        if self.cache is Cache.NONE:
            line += ["--cache", "none"]
        elif self.cache is not Cache.UNKNOWN:
            line += ["--cache", str(cache)]
        return line


@dataclass(frozen=True, slots=True)
class Plan:
    """What is asked for, all flights together; ``before`` None: no older version is compared.

    ``options`` are given to every run of ``geotag``, the older version's too.
    """

    flights: Sequence[Flight]
    groups: frozenset[str]
    after: Tool
    before: Tool | None
    folder: Path
    radii_m: Sequence[float]
    flat_frames: Sequence[int]
    flat_folder: Path | None
    map_gigabytes: float
    paper_frames: int
    options: tuple[str, ...] = ()
    views: int = CropTtaConfig().views


def installed(threads: int) -> Tool:
    """Return the ``uasthn`` that this process would import."""
    found = importlib.util.find_spec("uasthn_cli")
    assert found is not None
    assert found.origin is not None
    paths = [str(Path(found.origin).parent.parent)]
    paths += filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    absolute = os.pathsep.join(str(Path(path).absolute()) for path in paths)
    command = (sys.executable, "-m", "uasthn_cli")
    return Tool(command, _environment(threads, absolute))


def older(command: str, path: Path | None, threads: int) -> Tool:
    """Return another ``uasthn``: an executable, or a Python with a module and where that lies."""
    imports = "" if path is None else str(path.absolute())
    program, *arguments = shlex.split(command)
    # runs are in other folders, and a link into a virtual environment must stay that link
    started = str(Path(program).absolute()) if Path(program).exists() else program
    return Tool((started, *arguments), _environment(threads, imports))


def batches(plan: Plan) -> Iterator[list[Case]]:
    """Yield cases that are compared with each other, and so take turns."""
    for flight in plan.flights:
        yield _of_flight(plan, flight)
    if "paper" in plan.groups:
        yield _paper(plan)
    if "reach" in plan.groups:
        yield _reach(plan, plan.flights[0])
    if "flat" in plan.groups:
        yield _flat(plan)
    if "big-map" in plan.groups:
        yield _big_map(plan, plan.flights[0])
    if "start" in plan.groups:
        yield _start(plan, plan.flights[0])


def _environment(threads: int, imports: str) -> dict[str, str]:
    """Return what keeps libraries to so many threads, and a user's own cache out of it.

    Modules are compiled once, as an installation has them.
    """
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
    threads_each = dict.fromkeys(names, str(threads))
    return {
        **threads_each,
        "PYTHONPATH": imports,
        "PYTHONDONTWRITEBYTECODE": "",
        "UASTHN_CACHE": "none",
    }


def _geotag(plan: Plan, group: str, name: str, flight: Flight, **settings: Any) -> Case:
    title = f"{flight.name}: {flight.count} frames, search radius {flight.radius_m:g} m"
    case = Case(group, name, title, plan.after, flight.count, flight, geotags=True)
    extra = (*plan.options, *settings.pop("extra", ()))
    if "tool" not in settings and "--jobs" not in extra:
        extra = ("--jobs", "1", *extra)  # what frames cost is counted in one process
    return replace(case, **{"cache": Cache.NONE, "extra": extra, **settings})


def _in_parallel(jobs: str) -> dict[str, Any]:
    return {"extra": ("--jobs", jobs), "cache": Cache.KEPT}


def _script(plan: Plan, name: str, *arguments: str) -> Tool:
    return replace(plan.after, command=(sys.executable, str(_HERE / name), *arguments))


def _of_flight(plan: Plan, flight: Flight) -> list[Case]:
    """Return the rows that a flight has: the floor, the older version, and the installed one's."""
    floor = _script(plan, "floor.py", "{log}", "{frames}")
    one_view = ("--crops", "1", "--calibration", "none")
    cases = [_geotag(plan, "floor", "log and frames read", flight, tool=floor, geotags=False)]
    if plan.before is not None:
        by = {"tool": plan.before, "cache": Cache.UNKNOWN}
        cases.append(_geotag(plan, BEFORE, "before", flight, **by))
    cases += [
        _geotag(plan, "after", "first flight over a map", flight, cache=Cache.EMPTY),
        _geotag(plan, "after", "second flight", flight, cache=Cache.KEPT),
        _geotag(plan, "after", "no cache", flight),
        *(
            _geotag(plan, "jobs", f"second flight, --jobs {count}", flight, **_in_parallel(count))
            for count in ("1", "2", "auto")
        ),
        _geotag(plan, "crops", "no cache, one view", flight, extra=one_view),
        _geotag(plan, "crops", f"no cache, {plan.views} views", flight, extra=one_view[2:]),
    ]
    return [case for case in cases if case.group in plan.groups]


def _paper(plan: Plan) -> list[Case]:
    """Return the paper's network alone, on random frames: as published, and as written here."""
    views = str(plan.views)
    named = {
        "ihn as published, one view": "one view, plain",
        f"ihn as published, {views} views one by one": f"{views} views, plain",
        "ihn, one view": "one view",
        f"ihn, {views} views (CropTTA)": f"{views} views",
    }
    title = f"The paper's network alone, random weights, {plan.paper_frames} frames"
    return [
        Case("paper", name, title, _script(plan, "paper_cost.py", run, views, "{count}"), count)
        for count in [plan.paper_frames]
        for name, run in named.items()
    ]


def _reach(plan: Plan, flight: Flight) -> list[Case]:
    title = f"Reach, on {flight.name}: {flight.count} frames, features of the map kept"
    return [
        _geotag(
            plan,
            "reach",
            f"{radius_m:g} m",
            replace(flight, radius_m=radius_m),
            table=title,
            cache=Cache.KEPT,
        )
        for radius_m in plan.radii_m
    ]


def _flat(plan: Plan) -> list[Case]:
    folder = plan.flat_folder or plan.folder / "flat"
    flights = [rendered_flight(folder / str(count), count) for count in plan.flat_frames]
    title = "Longer flights: rendered, 160 × 128 px, search radius 100 m, no cache"
    return [_geotag(plan, "flat", flight.name, flight, table=title) for flight in flights]


def _big_map(plan: Plan, flight: Flight) -> list[Case]:
    title = f"A map of {plan.map_gigabytes:g} GB around that of {flight.name}, no cache"
    named = {"its own map": flight}
    for on_disk, name in ((False, "huge, tiles left out"), (True, "huge, of full length")):
        path = plan.folder / f"huge_{on_disk}.tif"
        named[name] = in_huge_map(flight, path, plan.map_gigabytes, on_disk=on_disk)
    return [_geotag(plan, "big-map", name, one, table=title) for name, one in named.items()]


def _start(plan: Plan, flight: Flight) -> list[Case]:
    """Return what a run takes before it does anything: its help, and its first frame."""
    alone = one_frame(flight, plan.folder / "first")
    cases = []
    for name, tool in (("before", plan.before), ("after", plan.after)):
        if tool is not None:
            asking = replace(tool, command=(*tool.command, "--help"))
            cases.append(Case("start", f"{name}: --help", _START, asking))
    if plan.before is not None:
        by = {"tool": plan.before, "cache": Cache.UNKNOWN}
        cases.append(_geotag(plan, "start", "before: first frame", alone, table=_START, **by))
    for name, cache in (("empty cache", Cache.EMPTY), ("kept features", Cache.KEPT)):
        first = f"after: first frame, {name}"
        cases.append(_geotag(plan, "start", first, alone, table=_START, cache=cache))
    return cases
