"""Log lines and progress: on stderr, in plain lines where there is no terminal."""

import logging
import os
import pty
import subprocess
import sys
from collections.abc import Iterator

import pytest

from uasthn_cli.commands.console import Verbosity, progress, say, set_verbosity

LOGGER = logging.getLogger("uasthn_cli.somewhere")


@pytest.fixture(autouse=True)
def _restored() -> Iterator[None]:
    yield
    set_verbosity(Verbosity.NORMAL)


@pytest.mark.parametrize(
    ("verbosity", "lines"),
    [
        (Verbosity.QUIET, ["uasthn: error: e"]),
        (Verbosity.NORMAL, ["uasthn: warning: w", "uasthn: error: e"]),
        (Verbosity.VERBOSE, ["uasthn: i", "uasthn: warning: w", "uasthn: error: e"]),
        (Verbosity.DEBUG, ["uasthn: d", "uasthn: i", "uasthn: warning: w", "uasthn: error: e"]),
    ],
)
def test_levels(verbosity: Verbosity, lines: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    set_verbosity(verbosity)
    LOGGER.debug("d")
    LOGGER.info("i")
    LOGGER.warning("w")
    LOGGER.error("e")
    captured = capsys.readouterr()
    assert captured.err.splitlines() == lines
    assert captured.out == ""


@pytest.mark.parametrize(
    ("verbosity", "is_shown"), [(Verbosity.NORMAL, False), (Verbosity.VERBOSE, True)]
)
def test_warnings_of_libraries_wait_for_verbose(
    verbosity: Verbosity, is_shown: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    set_verbosity(verbosity)
    logging.getLogger("py.warnings").warning("of a library")
    assert ("of a library" in capsys.readouterr().err) is is_shown


def test_progress_without_terminal_is_a_line_per_tenth(capsys: pytest.CaptureFixture[str]) -> None:
    set_verbosity(Verbosity.NORMAL)
    with progress("frames", 59, done=7) as advance:
        for steps in range(8, 60):
            advance(steps)
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.splitlines()
    assert lines[0] == "frames: 12 of 59"
    assert lines[-1] == "frames: 59 of 59"
    assert len(lines) == 9


def test_progress_of_nothing_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    set_verbosity(Verbosity.NORMAL)
    with progress("frames", 0) as advance:
        advance(0)
    assert capsys.readouterr().err == ""


def test_log_lines_stand_above_the_bar_on_a_terminal() -> None:
    program = (
        "import logging\n"
        "from uasthn_cli.commands.console import Verbosity, progress, set_verbosity\n"
        "set_verbosity(Verbosity.NORMAL)\n"
        "with progress('frames', 3) as advance:\n"
        "    advance(1)\n"
        "    logging.getLogger('uasthn_cli.x').warning('on a line of its own')\n"
        "    advance(3)\n"
    )
    terminal, its_end = pty.openpty()
    subprocess.run(
        [sys.executable, "-c", program],
        stderr=its_end,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "80"},
        check=True,
    )
    os.close(its_end)
    shown = os.read(terminal, 65536).decode()
    os.close(terminal)
    assert "\x1b[2Kuasthn: warning: on a line of its own\r\n" in shown
    assert "3/3" in shown


def test_quiet_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    set_verbosity(Verbosity.QUIET)
    say("done")
    with progress("frames", 3) as advance:
        advance(3)
    captured = capsys.readouterr()
    assert captured.err == ""
    assert captured.out == ""


def test_a_job_with_lines_of_its_own_gets_no_others(capsys: pytest.CaptureFixture[str]) -> None:
    with progress("training", 10, plain_lines=False) as advance:
        for step in range(10):
            advance(step + 1)
    assert capsys.readouterr().err == ""
