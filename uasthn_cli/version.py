"""Which code runs: the release, and a hash that tells unreleased states of it apart."""

import hashlib
from functools import cache
from pathlib import Path
from typing import Final

from uasthn_cli import __version__

_PACKAGE: Final = Path(__file__).parent

HASH_DIGITS: Final = 8
"""Digits of a source's hash that a version shows."""


@cache
def code_sha256() -> str:
    """Return a hash of the package's source: what one state of the code made, another must not use.

    It is the same for a checkout and for what is installed from it, and another after any edit,
    committed or not.
    """
    return source_sha256(_PACKAGE)


def code_version() -> str:
    """Return the release with :func:`code_sha256`'s start, as PEP 440 writes local versions."""
    return f"{__version__}+src.{code_sha256()[:HASH_DIGITS]}"


def source_sha256(path: Path) -> str:
    """Return a hash of a Python file, or of a package's folder.

    Of a folder, Python files count with their content, all others by name and size: weights are
    large, and a run records the hash of those it uses.
    """
    root = path if path.is_dir() else path.parent
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    digest = hashlib.sha256()
    for file in files:
        if _is_no_part(file):
            continue
        is_source = file.suffix == ".py"
        content = file.read_bytes() if is_source else str(file.stat().st_size).encode()
        name = file.relative_to(root).as_posix()
        digest.update(f"{name}\0{len(content)}\0".encode("utf-8", "surrogateescape") + content)
    return digest.hexdigest()


def _is_no_part(file: Path) -> bool:
    """Tell folders, compiled files and what editors leave from what belongs to a package."""
    is_hidden = file.name.startswith(".") or file.name.endswith("~")
    return is_hidden or "__pycache__" in file.parts or not file.is_file()
