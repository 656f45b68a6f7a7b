"""README and docs name every reason, exit code, column, section and command that there is."""

import json
import re
from pathlib import Path

import pytest

from uasthn_cli import errors
from uasthn_cli.commands.main import COMMANDS
from uasthn_cli.errors import UasthnError
from uasthn_cli.outputs.run_record import RunRecord, RunTiming, run_json
from uasthn_cli.outputs.table import columns
from uasthn_cli.outputs.truth import Truth
from uasthn_cli.types import Reason

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
RESULTS = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")


def first_cells(page: str, heading: str) -> list[str]:
    """Return the first column of the table below a heading, without its two header rows."""
    section = page.split(f"# {heading}\n", maxsplit=1)[1].split("\n#", maxsplit=1)[0]
    return [line.split("|")[1].strip() for line in section.splitlines() if line[:1] == "|"][2:]


def names_in(cells: list[str]) -> list[str]:
    """Return what the cells set in backticks, in their order."""
    return [name for cell in cells for name in re.findall(r"`(.+?)`", cell)]


def test_reasons() -> None:
    assert sorted(first_cells(RESULTS, "Reasons")) == sorted(f"`{reason}`" for reason in Reason)


def test_exit_codes() -> None:
    classes = [kind for kind in vars(errors).values() if isinstance(kind, type)]
    codes = {kind.exit_code for kind in classes if issubclass(kind, UasthnError)}
    assert [int(cell) for cell in first_cells(RESULTS, "Exit codes")] == sorted(codes | {0, 2})


def test_columns() -> None:
    truth = Truth(path=Path("truth.csv"), frames={}, has_camera=True)
    listed = names_in(first_cells(RESULTS, "Columns of `frames.csv`"))
    written = columns(truth, "EPSG:4326", with_single=True)
    assert [name for name in listed if name in written] == listed
    between = {
        "tl_lat": "br_lon",
        "u_tl_x_m": "u_br_y_m",
        "single_accepted": "single_mace_m",
    }
    expected = iter(written)
    for name in listed:
        assert name in expected, f"{name} stands in another place in the table"
    ranges = [written[written.index(a) : written.index(b) + 1] for a, b in between.items()]
    assert set(written) == set(listed).union(*ranges)


def test_columns_that_the_readme_picks_out() -> None:
    picked = names_in(first_cells(README, "Results"))
    assert picked and set(picked) <= set(names_in(first_cells(RESULTS, "Columns of `frames.csv`")))


def test_sections_of_run_json() -> None:
    timing = RunTiming(started_utc_s=0.0, wall_s=1.0, computed_frames=0, stage_s={})
    written = json.loads(run_json(RunRecord({}, {}, {}, {}, {}, timing), []))
    assert names_in(first_cells(RESULTS, "Sections of `run.json`")) == list(written)


@pytest.mark.parametrize("name", list(COMMANDS))
def test_commands(name: str) -> None:
    assert any(cell.startswith(f"`uasthn {name}") for cell in first_cells(README, "Commands"))
