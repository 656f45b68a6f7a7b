"""Flights given on the command line, each with its field of view and search radius."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])

_FOLDER: Final = click.Path(exists=True, path_type=Path)
_NUMBERS: Final[dict[str, Any]] = {
    "type": float,
    "multiple": True,
    "required": True,
    "help": "Once for all flights, or once for each.",
}


def flight_arguments(command: F) -> F:
    """Add ``folders``, ``hfovs_deg`` and ``radii_m``: flights and what :func:`each` spreads."""
    options = (
        click.argument("folders", nargs=-1, required=True, type=_FOLDER),
        click.option("--hfov", "hfovs_deg", metavar="DEG", **_NUMBERS),
        click.option("--search-radius", "radii_m", metavar="M", **_NUMBERS),
    )
    for option in reversed(options):
        command = option(command)
    return command


def each(option: str, values: tuple[float, ...], folders: tuple[Path, ...]) -> tuple[float, ...]:
    """Return one value for each flight.

    Raises:
        click.UsageError: there are neither one nor as many as flights.
    """
    if len(values) not in {1, len(folders)}:
        raise click.UsageError(f"give {option} once, or once for each flight")
    return values * len(folders) if len(values) == 1 else values
