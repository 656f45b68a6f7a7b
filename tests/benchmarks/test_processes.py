"""What a process took is its own, not that of whoever started it."""

import sys
from pathlib import Path

import numpy as np
import pytest
from processes import CommandError, measured


def test_a_process_does_not_inherit_memory(tmp_path: Path) -> None:
    held = np.ones(300 * 2**20, np.uint8)  # in this process, which starts the others
    small = measured([sys.executable, "-S", "-c", "pass"], {}, tmp_path)
    large = measured([sys.executable, "-S", "-c", "b'1' * (200 * 2**20)"], {}, tmp_path)
    assert small.peak_mib < 100
    assert 200 < large.peak_mib < held.nbytes / 2**20
    assert small.cpu_s > 0.0
    assert small.wall_s > 0.0


def test_children_count(tmp_path: Path) -> None:
    inner = "b'1' * (200 * 2**20)"
    outer = f"import subprocess, sys; subprocess.run([sys.executable, '-S', '-c', {inner!r}])"
    assert measured([sys.executable, "-c", outer], {}, tmp_path).peak_mib > 200


def test_environment_and_folder_are_the_commands(tmp_path: Path) -> None:
    code = "import os; open(os.environ['NAME'], 'w').close()"
    measured([sys.executable, "-c", code], {"NAME": "made"}, tmp_path)
    assert (tmp_path / "made").exists()


def test_a_failure_says_what_the_command_said(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="exit code 3: it was / too large"):
        code = "import sys; print('it was\\n\\ntoo large'); sys.exit(3)"
        measured([sys.executable, "-c", code], {}, tmp_path)
