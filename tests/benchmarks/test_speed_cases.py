"""Command lines of what is measured."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from small_flight import HFOV_DEG, make_flight
from speed_cases import GROUPS, Cache, Case, Plan, batches, installed, older
from speed_inputs import Flight, flight_of


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    folder = make_flight(tmp_path_factory.mktemp("flights") / "small", count=2).log.parent
    return flight_of(folder, HFOV_DEG, 40.0)


def plan_of(flight: Flight, folder: Path, *groups: str) -> Plan:
    return Plan(
        flights=[flight],
        groups=frozenset(groups),
        after=installed(1),
        before=older(f"{sys.executable} -m uasthn_cli", folder, 2),
        folder=folder,
        radii_m=[40.0, 60.0],
        flat_frames=[2, 3],
        flat_folder=None,
        map_gigabytes=0.1,
        paper_frames=2,
    )


def cases_of(plan: Plan) -> list[Case]:
    return [case for batch in batches(plan) for case in batch]


@pytest.mark.parametrize("group", GROUPS)
def test_every_group_has_rows_of_its_own(group: str, flight: Flight, tmp_path: Path) -> None:
    cases = cases_of(plan_of(flight, tmp_path, group))
    assert cases
    assert {case.group for case in cases} == {group}
    names = [(case.table, case.name) for case in cases]
    assert len(set(names)) == len(names)


def test_versions_are_told_apart(flight: Flight, tmp_path: Path) -> None:
    plan = plan_of(flight, tmp_path, "before", "after")
    before, first, second, none = cases_of(replace(plan, options=("--estimator", "ncc")))
    assert before.tool.environment["PYTHONPATH"] == str(tmp_path)
    assert before.tool.environment["OMP_NUM_THREADS"] == "2"
    assert str(tmp_path) not in first.tool.environment["PYTHONPATH"]
    lines = [
        case.arguments(flight, 2, Path("out"), Path("cache"))
        for case in (before, first, second, none)
    ]
    assert [line[line.index("--cache") + 1] for line in lines[1:]] == ["cache", "cache", "none"]
    assert "--cache" not in lines[0]
    assert (first.cache, second.cache) == (Cache.EMPTY, Cache.KEPT)
    assert all(line[line.index("--estimator") + 1] == "ncc" for line in lines)


def test_a_program_is_found_from_other_folders(tmp_path: Path) -> None:
    (tmp_path / "uasthn").symlink_to(sys.executable)
    tool = older(f"{tmp_path / 'uasthn'} --flag", None, 1)
    assert tool.command == (str(tmp_path / "uasthn"), "--flag")
    assert older("uasthn-of-old", None, 1).command == ("uasthn-of-old",)
