"""Whole files or none: write beside the target, then rename over it."""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from uasthn_cli.errors import OutputError


def write_bytes(path: Path, content: bytes) -> None:
    """Write one file atomically.

    Raises:
        OutputError: the file cannot be written; what stood there before is untouched.
    """
    write_files([(path, content)])


def write_text(path: Path, content: str) -> None:
    """Write one UTF-8 file atomically, line ends as they are.

    Raises:
        OutputError: the file cannot be written; what stood there before is untouched.
    """
    write_bytes(path, content.encode("utf-8"))


def write_files(
    files: Sequence[tuple[Path, bytes | Iterable[bytes]]], marker: Path | None = None
) -> None:
    """Write several files: all are on disk in full before the first one is renamed into place.

    A content may come in pieces, so that no file need be in memory as a whole.

    ``marker`` is a file whose presence says that the set is complete: it is removed before the
    first rename. Pass its new content as the last of ``files``.

    Raises:
        OutputError: a file cannot be written; nothing that stood there before is touched.
    """
    staged = [(_temporary(path), path) for path, _ in files]
    try:
        for (temporary, _), (_, content) in zip(staged, files, strict=True):
            _write_through(temporary, content)
        if marker is not None:
            marker.unlink(missing_ok=True)
        for temporary, path in staged:
            temporary.replace(path)
    except OSError as error:
        folder = files[0][0].parent
        raise OutputError(f"cannot write to {folder}: {error.strerror or error}") from error
    finally:
        for temporary, _ in staged:
            _discard(temporary)


def remove_leftovers(path: Path) -> None:
    """Remove temporary files that killed processes left beside ``path``."""
    for leftover in path.parent.glob(f".{path.name}.*.tmp"):
        _discard(leftover)


def _temporary(path: Path) -> Path:
    """Return a name in the same folder (a rename across file systems is not atomic)."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


def _write_through(path: Path, content: bytes | Iterable[bytes]) -> None:
    """Write bytes and wait until the disk has them: a rename must not overtake its content."""
    with path.open("wb") as handle:
        handle.writelines([content] if isinstance(content, bytes) else content)
        handle.flush()
        os.fsync(handle.fileno())


def _discard(path: Path) -> None:
    """Remove a file if it is there; its folder may not even be one."""
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return
