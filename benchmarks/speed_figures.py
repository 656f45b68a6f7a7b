"""What runs took: measured in turns, the smallest time of each case counts."""

import json
import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from processes import CommandError, Usage, measured
from speed_cases import Cache, Case
from speed_inputs import Flight, one_frame

OUTSIDE = "start, end"
"""Start-up, imports, the last files and the exit: the process's time beyond the run's own."""
OTHER = "other"
"""What a run does outside its stages: opening map and networks, hashing the inputs."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One process; ``stage_s`` is empty where nothing was geo-tagged."""

    usage: Usage
    stage_s: Mapping[str, float]
    version: str | None = None


@dataclass(slots=True)
class Figures:
    """All samples of a case: of all its frames, and of one of them."""

    case: Case
    whole: list[Sample] = field(default_factory=list)
    one: list[Sample] = field(default_factory=list)
    error: str | None = None

    @property
    def cpu_s(self) -> list[float]:
        """CPU seconds of each repetition."""
        return [sample.usage.cpu_s for sample in self.whole]

    @property
    def wall_s(self) -> list[float]:
        """Seconds on the clock of each repetition."""
        return [sample.usage.wall_s for sample in self.whole]

    @property
    def peak_mib(self) -> float:
        """The largest peak of all repetitions."""
        return max(sample.usage.peak_mib for sample in self.whole)

    @property
    def best(self) -> Sample:
        """The repetition that took the least CPU time."""
        return min(self.whole, key=lambda sample: sample.usage.cpu_s)

    def a_frame_s(self, times: Callable[[Usage], float], *, further: bool) -> float:
        """Return seconds a frame: all divided by all frames, or what each ``further`` one adds."""
        whole_s = min(times(sample.usage) for sample in self.whole)
        if not further:
            return whole_s / self.case.count
        if self.case.count < 2 or not self.one:
            return math.nan
        one_s = min(times(sample.usage) for sample in self.one)
        return (whole_s - one_s) / (self.case.count - 1)

    def row(self) -> dict[str, float]:
        """Return every figure by its name."""
        figures = {
            "cpu_min_s": min(self.cpu_s),
            "cpu_median_s": median(self.cpu_s),
            "wall_min_s": min(self.wall_s),
            "wall_median_s": median(self.wall_s),
            "peak_mib": self.peak_mib,
        }
        for kind, further in (("frame", False), ("further_frame", True)):
            figures[f"cpu_ms_{kind}"] = 1e3 * self.a_frame_s(lambda u: u.cpu_s, further=further)
            figures[f"wall_ms_{kind}"] = 1e3 * self.a_frame_s(lambda u: u.wall_s, further=further)
        return figures


def measure(
    cases: Sequence[Case], repeats: int, folder: Path, say: Callable[[str], None]
) -> list[Figures]:
    """Run cases in turns, each over its flight and over one frame of that, so many times.

    A case that fails is not run again, and says why.
    """
    found = [Figures(case) for case in cases]
    folder.mkdir(parents=True)
    alone: dict[int, Flight | None] = {}
    for index, case in enumerate(cases):
        flight = case.flight
        alone[index] = None if flight is None else one_frame(flight, folder / f"one-{index}")
    for turn in range(repeats):
        for index, figures in enumerate(found):
            if figures.error is None:
                say(f"{figures.case.table}: {figures.case.name}, {turn + 1} of {repeats}")
                _measure_once(figures, alone[index], folder / f"turn-{turn}")
                if figures.error is not None:
                    say(f"{figures.case.name}: left out: {figures.error}")
    shutil.rmtree(folder)
    return found


def _measure_once(figures: Figures, alone: Flight | None, folder: Path) -> None:
    """Add one sample of all frames and, where there are several, of one frame."""
    case = figures.case
    try:
        figures.whole.append(_sample(case, case.flight, case.count, folder))
        if case.count > 1:
            figures.one.append(_sample(case, alone, 1, folder))
    except CommandError as error:
        figures.error = str(error)


def _sample(case: Case, flight: Flight | None, count: int, folder: Path) -> Sample:
    """Run a case in a folder that lies in no source tree: Python looks for modules there first."""
    out, cache = folder / "out", folder / "cache"
    if case.cache is Cache.EMPTY and count < case.count:
        cache = folder / "cache-of-one"
    if case.cache is Cache.EMPTY:
        shutil.rmtree(cache, ignore_errors=True)
    folder.mkdir(exist_ok=True)
    shutil.rmtree(out, ignore_errors=True)  # of a run that failed
    usage = measured(case.arguments(flight, count, out, cache), case.tool.environment, folder)
    if not case.geotags:
        return Sample(usage, {})
    record = json.loads((out / "run.json").read_text(encoding="utf-8"))
    return Sample(usage, _stages(record["timing"], usage.wall_s), record["version"])


def _stages(timing: Mapping[str, object], wall_s: float) -> dict[str, float]:
    """Return seconds by stage as the run itself counted them, and what is beyond these."""
    stages, run_s = timing["stages"], timing["wall_s"]
    assert isinstance(stages, dict)
    assert isinstance(run_s, float)
    stage_s = {name: float(entry["seconds"]) for name, entry in stages.items()}
    return stage_s | {OTHER: run_s - sum(stage_s.values()), OUTSIDE: wall_s - run_s}
