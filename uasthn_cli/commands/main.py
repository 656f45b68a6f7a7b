"""The ``uasthn`` command: its subcommands, loaded on demand, and the one net for errors."""

import importlib
import logging
import sys
from typing import Any, Final, NoReturn

import click

from uasthn_cli import __version__
from uasthn_cli.commands.console import Verbosity, set_verbosity
from uasthn_cli.errors import UasthnError

LOGGER = logging.getLogger(__name__)

INTERRUPTED_EXIT_CODE: Final = 130
UNEXPECTED_EXIT_CODE: Final = 1

COMMANDS: Final = {
    "geotag": "uasthn_cli.commands.geotag:geotag",
    "report": "uasthn_cli.commands.report:report",
    "calibrate": "uasthn_cli.commands.calibrate:calibrate",
    "demo": "uasthn_cli.commands.demo:demo",
    "train": "uasthn_cli.commands.train:train",
    "tgm": "uasthn_cli.commands.tgm:tgm",
    "evaluate": "uasthn_cli.commands.evaluate:evaluate",
    "synth": "uasthn_cli.commands.synth:synth",
    "models": "uasthn_cli.commands.models:models",
    "cameras": "uasthn_cli.commands.cameras:cameras",
    "completion": "uasthn_cli.commands.completion:completion",
}
"""Subcommands in the order of ``--help``; a module is imported when its command is asked for."""


def _handle_quiet(_: click.Context, __: click.Parameter, is_quiet: bool) -> None:
    """Say nothing but errors from here on."""
    if is_quiet:
        set_verbosity(Verbosity.QUIET)


def _handle_verbose(_: click.Context, __: click.Parameter, count: int) -> None:
    """Say more from here on, or everything."""
    if count:
        set_verbosity(Verbosity.VERBOSE if count == 1 else Verbosity.DEBUG)


def verbosity_options() -> list[click.Parameter]:
    """Return new ``-v`` and ``-q`` options, which the group and every command accept."""
    return [
        click.Option(
            ["-v", "--verbose"],
            count=True,
            expose_value=False,
            callback=_handle_verbose,
            help="Say what is being done; twice: everything. Shows tracebacks.",
        ),
        click.Option(
            ["-q", "--quiet"],
            is_flag=True,
            expose_value=False,
            callback=_handle_quiet,
            help="Say nothing but errors.",
        ),
    ]


class Face(click.Group):
    """A group that imports a subcommand's module when it is asked for, and ends in exit codes."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the subcommands in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a subcommand, with the options that every command has."""
        if cmd_name not in COMMANDS:
            return None
        if cmd_name not in self.commands:
            module, attribute = COMMANDS[cmd_name].split(":")
            command: click.Command = getattr(importlib.import_module(module), attribute)
            command.params.extend(verbosity_options())
            self.commands[cmd_name] = command
        return self.commands[cmd_name]

    def main(self, *args: Any, **kwargs: Any) -> NoReturn:
        """Run the command line and exit: see docs/results.md for the codes."""
        set_verbosity(Verbosity.NORMAL)
        kwargs["standalone_mode"] = False
        try:
            returned = super().main(*args, **kwargs)
        except click.ClickException as error:
            error.show()
            sys.exit(error.exit_code)
        except click.Abort:
            _fail("interrupted; nothing is half-written, run the same command again")
            sys.exit(INTERRUPTED_EXIT_CODE)
        except UasthnError as error:
            _fail(str(error))
            sys.exit(error.exit_code)
        except Exception as error:  # what nobody foresaw also ends in one line
            _fail(f"unexpected {type(error).__name__}: {error} (run with -v for the traceback)")
            LOGGER.info("traceback of the error above", exc_info=True)
            sys.exit(UNEXPECTED_EXIT_CODE)
        sys.exit(returned if isinstance(returned, int) else 0)


def _fail(message: str) -> None:
    """Print the one line that ends a run."""
    click.echo(f"uasthn: error: {' '.join(message.splitlines())}", err=True)


@click.group(cls=Face, params=verbosity_options(), context_settings={"max_content_width": 100})
@click.version_option(__version__, package_name="uasthn", prog_name="uasthn")
def main() -> None:
    """Tell where a drone's thermal frames were taken when GPS cannot be trusted.

    Reads a MAVLink log and a folder of frames that look straight down, finds each frame on a
    georeferenced satellite map, and says how far each answer can be trusted.
    """
