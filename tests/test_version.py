"""The version tells states of the code apart that were never released."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from uasthn_cli import __version__
from uasthn_cli.version import code_version, source_sha256


@pytest.fixture
def package(tmp_path: Path) -> Path:
    folder = tmp_path / "package"
    (folder / "room").mkdir(parents=True)
    (folder / "room" / "__init__.py").write_text("X = 1\n")
    (folder / "a.safetensors").write_bytes(b"1234")
    return folder


def test_it_is_the_release_and_a_local_version() -> None:
    assert re.fullmatch(re.escape(__version__) + r"\+src\.[0-9a-f]{8}", code_version())


def test_another_process_and_place_have_the_same(tmp_path: Path) -> None:
    program = "from uasthn_cli.version import code_version; print(code_version())"
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert ran.stdout.strip() == code_version()


def test_every_edit_shows(package: Path) -> None:
    digests = [source_sha256(package)]
    (package / "room" / "__init__.py").write_text("X = 2\n")
    digests.append(source_sha256(package))
    (package / "room" / "new.py").write_text("")
    digests.append(source_sha256(package))
    (package / "room" / "new.py").rename(package / "new.py")
    digests.append(source_sha256(package))
    (package / "a.safetensors").write_bytes(b"12345")
    digests.append(source_sha256(package))
    assert len(set(digests)) == len(digests)


def test_what_is_no_part_of_the_code_does_not(package: Path) -> None:
    before = source_sha256(package)
    (package / "__pycache__").mkdir()
    (package / "__pycache__" / "a.cpython-311.pyc").write_bytes(b"compiled")
    (package / ".swap.py").write_text("edited")
    (package / "old.py~").write_text("edited")
    assert source_sha256(package) == before


def test_a_module_of_one_file_has_one_too(package: Path) -> None:
    module = package / "room" / "__init__.py"
    before = source_sha256(module)
    module.write_text("X = 3\n")
    assert source_sha256(module) != before
