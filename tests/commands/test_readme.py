"""The README names every reason, exit code, column and command that there is."""

import re
from pathlib import Path

import pytest

from uasthn_cli import errors
from uasthn_cli.commands.main import COMMANDS
from uasthn_cli.errors import UasthnError
from uasthn_cli.outputs.table import columns
from uasthn_cli.outputs.truth import Truth
from uasthn_cli.types import Reason

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def first_cells(heading: str) -> list[str]:
    """Return the first column of the table below a heading, without its two header rows."""
    section = README.split(f"# {heading}\n", maxsplit=1)[1].split("\n#", maxsplit=1)[0]
    return [line.split("|")[1].strip() for line in section.splitlines() if line[:1] == "|"][2:]


def test_reasons() -> None:
    assert sorted(first_cells("Reasons")) == sorted(f"`{reason}`" for reason in Reason)


def test_exit_codes() -> None:
    classes = [kind for kind in vars(errors).values() if isinstance(kind, type)]
    codes = {kind.exit_code for kind in classes if issubclass(kind, UasthnError)}
    assert [int(cell) for cell in first_cells("Exit codes")] == sorted(codes | {0, 2})


def test_columns() -> None:
    truth = Truth(path=Path("truth.csv"), frames={}, has_camera=True)
    listed = [
        name
        for cell in first_cells("Columns of `frames.csv`")
        for name in re.findall(r"`(.+?)`", cell)
    ]
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


@pytest.mark.parametrize("name", list(COMMANDS))
def test_commands(name: str) -> None:
    assert any(cell.startswith(f"`uasthn {name}") for cell in first_cells("Commands"))
