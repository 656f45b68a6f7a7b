"""The group: what it loads, what it says, and how it exits."""

import os
import subprocess
import sys
from collections.abc import Iterator

import click
import pytest
from click.testing import CliRunner

from uasthn_cli import __version__
from uasthn_cli.commands import main as main_module
from uasthn_cli.commands.main import COMMANDS, main
from uasthn_cli.errors import MapUnreadableError

HEAVY_MODULES = ("torch", "rasterio", "pandas", "cv2", "pymavlink", "scipy", "pyproj", "PIL")


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, BaseException]]:
    """Register a command ``fail`` that raises whatever is put under the key ``error``."""
    raised: dict[str, BaseException] = {}

    @click.command()
    def fail() -> None:
        raise raised["error"]

    monkeypatch.setitem(main_module.COMMANDS, "fail", "nowhere:fail")
    monkeypatch.setitem(main.commands, "fail", fail)
    fail.params.extend(main_module.verbosity_options())
    yield raised


def test_help_imports_nothing_heavy() -> None:
    program = (
        "import sys\n"
        "from uasthn_cli.commands.main import main\n"
        "try:\n    main(['--help'])\n"
        "except SystemExit as end:\n    assert end.code == 0\n"
        f"print([name for name in {HEAVY_MODULES!r} if name in sys.modules], file=sys.stderr)"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert ran.stderr.strip() == "[]"
    assert all(name in ran.stdout for name in COMMANDS)


@pytest.mark.parametrize("name", list(COMMANDS))
def test_every_command_explains_itself_and_can_be_quiet(name: str) -> None:
    result = CliRunner().invoke(main, [name, "--help"])
    assert result.exit_code == 0
    assert "--quiet" in result.stdout
    assert "--verbose" in result.stdout


def test_module_and_console_script_are_the_same() -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "uasthn_cli", "--version"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert ran.stdout == f"uasthn, version {__version__}\n"


def test_unknown_command_is_a_usage_error() -> None:
    result = CliRunner().invoke(main, ["geotga"])
    assert result.exit_code == 2
    assert "No such command 'geotga'" in result.stderr


def test_known_error_is_one_line_with_its_code(failing: dict[str, BaseException]) -> None:
    failing["error"] = MapUnreadableError("map.tif: not a raster;\ngive a GeoTIFF")
    result = CliRunner().invoke(main, ["fail"])
    assert result.exit_code == MapUnreadableError.exit_code
    assert result.stderr == "uasthn: error: map.tif: not a raster; give a GeoTIFF\n"
    assert result.stdout == ""


def test_interrupt_exits_130(failing: dict[str, BaseException]) -> None:
    failing["error"] = KeyboardInterrupt()
    result = CliRunner().invoke(main, ["fail"])
    assert result.exit_code == 130
    assert "interrupted" in result.stderr
    assert "Traceback" not in result.stderr


def test_unexpected_error_is_one_line(failing: dict[str, BaseException]) -> None:
    failing["error"] = ZeroDivisionError("by zero")
    result = CliRunner().invoke(main, ["fail"])
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1
    assert "ZeroDivisionError: by zero" in result.stderr


@pytest.mark.parametrize("arguments", [["-v", "fail"], ["fail", "-v"]])
def test_verbose_shows_the_traceback(
    failing: dict[str, BaseException], arguments: list[str]
) -> None:
    failing["error"] = ZeroDivisionError("by zero")
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 1
    assert "Traceback (most recent call last)" in result.stderr


def test_verbosity_does_not_outlive_a_run(failing: dict[str, BaseException]) -> None:
    failing["error"] = ZeroDivisionError("by zero")
    CliRunner().invoke(main, ["-v", "fail"])
    assert "Traceback" not in CliRunner().invoke(main, ["fail"]).stderr


def test_closed_pipe_is_no_crash() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    ran = subprocess.run(
        [sys.executable, "-m", "uasthn_cli", "completion", "fish"],
        stdout=writer,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    os.close(writer)
    assert ran.returncode == 1
    assert ran.stderr == ""


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_script_names_the_command(shell: str) -> None:
    result = CliRunner().invoke(main, ["completion", shell])
    assert result.exit_code == 0
    assert f"_UASTHN_COMPLETE={shell}_complete" in result.stdout


def test_completion_offers_the_commands() -> None:
    environment = {
        **os.environ,
        "_UASTHN_COMPLETE": "bash_complete",
        "COMP_WORDS": "uasthn comp",
        "COMP_CWORD": "1",
    }
    ran = subprocess.run(
        [
            sys.executable,
            "-c",
            "from uasthn_cli.commands.main import main; main(prog_name='uasthn')",
        ],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert ran.stdout.splitlines() == ["plain,completion"]
