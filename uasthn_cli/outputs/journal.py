"""What a run has finished so far: nothing is computed twice when the process dies."""

import json
import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Final, Generic, Self, TypeVar

from uasthn_cli.errors import OutputError
from uasthn_cli.outputs.formatting import frame_of
from uasthn_cli.outputs.result_json import (
    decode_located,
    decode_near_look,
    encode_located,
    encode_near_look,
)

LOGGER = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class JournalKind(Generic[T]):
    """What a journal holds: its file, one entry as a line and back, and the frame it is of."""

    file_name: str
    encode: Callable[[T], str]
    decode: Callable[[bytes], T]
    frame_name: Callable[[T], str]


LOCATED: Final = JournalKind(
    ".frames.partial.jsonl",
    encode_located,
    decode_located,
    lambda located: frame_of(located.result).name,
)
"""What frames gave alone."""

NEAR_LOOKS: Final = JournalKind(
    ".near.partial.jsonl", encode_near_look, decode_near_look, lambda look: look.frame.name
)
"""Second looks, near where the flight settled."""

JOURNAL_NAME: Final = LOCATED.file_name


class Journal(Generic[T]):
    """One line of JSON per finished frame, behind a first line that says what it belongs to.

    Opening reads back what an earlier run with the same fingerprint finished (``finished``, by
    frame name) and goes on after it; a torn last line is cut off, the journal of other inputs or
    arguments is discarded.
    """

    def __init__(self, out_dir: Path, fingerprint: str, kind: JournalKind[T]) -> None:
        """Open or start the journal of a results folder.

        Raises:
            OutputError: it cannot be read or written.
        """
        self.path, self._kind = out_dir / kind.file_name, kind
        header = (json.dumps({"fingerprint": fingerprint}) + "\n").encode("ascii")
        try:
            self._finished, kept_bytes = _read_back(self.path, header, kind)
            self._file: BinaryIO = self.path.open("r+b" if kept_bytes else "wb")
            self._file.truncate(kept_bytes)
            self._file.seek(kept_bytes)
            if not kept_bytes:
                self._write(header)
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror or error}") from error

    @property
    def finished(self) -> Mapping[str, T]:
        """Entries by frame name: read back, and appended since."""
        return self._finished

    def append(self, entry: T) -> None:
        """Add a finished frame; it survives the death of the process from here on.

        Raises:
            OutputError: the journal cannot be written (say, a full disk).
        """
        try:
            self._write(self._kind.encode(entry).encode("ascii") + b"\n")
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror or error}") from error
        self._finished[self._kind.frame_name(entry)] = entry

    def close(self) -> None:
        """Close the file and keep it for the next run.

        Closing tries once more to write what a full disk refused: that was reported when it arose.
        """
        with suppress(OSError):
            self._file.close()

    def remove(self) -> None:
        """Close and delete the file: the final results are written."""
        self.close()
        self.path.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        """Return the journal."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the file and keep it, whatever ended the run."""
        self.close()

    def _write(self, line: bytes) -> None:
        """Hand a line to the operating system."""
        self._file.write(line)
        self._file.flush()


def _read_back(path: Path, header: bytes, kind: JournalKind[T]) -> tuple[dict[str, T], int]:
    """Return finished entries by frame name, and how many bytes of the file hold them."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return {}, 0
    if not content.startswith(header):
        LOGGER.warning("%s belongs to other inputs or arguments and is discarded", path)
        return {}, 0
    finished: dict[str, T] = {}
    kept_bytes = len(header)
    for line in content[kept_bytes:].splitlines(keepends=True):
        try:
            entry = kind.decode(line)
        except ValueError:
            break
        if not line.endswith(b"\n"):
            break
        finished[kind.frame_name(entry)] = entry
        kept_bytes += len(line)
    LOGGER.info("%d finished frames are taken over from %s", len(finished), path)
    return finished, kept_bytes
