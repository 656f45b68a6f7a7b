"""Run a command and learn what it cost: start-up, imports and its own children included.

A child of a large process inherits that one's peak memory until it becomes another program, and the
kernel keeps the larger figure. So a small interpreter starts the command: this file run as a script
(it imports only the standard library).
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

_MIB = 1024.0 * 1024.0
_MAXRSS_BYTES = 1 if sys.platform == "darwin" else 1024
"""The unit of ``ru_maxrss``."""


class CommandError(Exception):
    """A measured command failed; the message holds the end of what it said."""


@dataclass(frozen=True, slots=True)
class Usage:
    """What one process took: user and system seconds, seconds on the clock, peak memory."""

    cpu_s: float
    wall_s: float
    peak_mib: float


def measured(command: Sequence[str], environment: Mapping[str, str], folder: Path) -> Usage:
    """Run a command in a folder with additional environment variables; return what it took.

    Raises:
        CommandError: it ended with another exit code than 0.
    """
    with tempfile.TemporaryDirectory() as own:
        report, said = Path(own) / "usage.json", Path(own) / "said.txt"
        with said.open("wb") as stream:
            ended = subprocess.run(
                [sys.executable, "-I", "-S", __file__, str(report), *command],
                cwd=folder,
                env={**os.environ, **environment},
                stdout=stream,
                stderr=subprocess.STDOUT,
                check=False,
            )
        if ended.returncode != 0:
            words = said.read_text(encoding="utf-8", errors="replace").splitlines()
            last = [line.strip() for line in words if line.strip()][-2:]
            raise CommandError(f"exit code {ended.returncode}: {' / '.join(last)}")
        return Usage(**json.loads(report.read_text(encoding="utf-8")))


def usage_of(command: Sequence[str]) -> tuple[int, Usage]:
    """Return a command's exit code and usage, as the kernel counts it for this one process."""
    started_s = time.perf_counter()
    # Popen.wait would take the process away before its usage can be asked for
    process = subprocess.Popen(command)
    _, status, used = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - started_s
    process.returncode = os.waitstatus_to_exitcode(status)
    peak_mib = used.ru_maxrss * _MAXRSS_BYTES / _MIB
    return process.returncode, Usage(used.ru_utime + used.ru_stime, wall_s, peak_mib)


def _main(report: str, *command: str) -> int:
    code, usage = usage_of(command)
    Path(report).write_text(json.dumps(asdict(usage)), encoding="utf-8")
    return code if code >= 0 else 128 - code


if __name__ == "__main__":
    sys.exit(_main(*sys.argv[1:]))
