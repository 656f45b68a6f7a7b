"""What a run has finished so far: nothing is computed twice when the process dies."""

import json
import logging
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Final, Generic, NamedTuple, Self, TypeVar

from uasthn_cli.errors import OutputError
from uasthn_cli.outputs.formatting import frame_of
from uasthn_cli.outputs.result_json import (
    decode_located,
    decode_refined_frame,
    encode_located,
    encode_refined_frame,
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

REFINED: Final = JournalKind(
    ".refined.partial.jsonl",
    encode_refined_frame,
    decode_refined_frame,
    lambda entry: entry.frame.name,
)
"""Frames refined near where the flight settled."""

JOURNAL_NAME: Final = LOCATED.file_name


class Journal(Generic[T]):
    """One line of JSON per finished frame, behind a first line that says what it belongs to.

    Opening goes on after what an earlier run with the same fingerprint finished (``finished``, by
    frame name). Each line ends in its checksum: one that was damaged is as good as not there, a
    torn last one is cut off. The journal of other inputs or arguments is discarded. Only the places
    of lines are kept in memory.
    """

    def __init__(self, out_dir: Path, fingerprint: str, kind: JournalKind[T]) -> None:
        """Open or start the journal of a results folder.

        Raises:
            OutputError: it cannot be read or written.
        """
        self.path, self._kind = out_dir / kind.file_name, kind
        header = (json.dumps({"fingerprint": fingerprint}) + "\n").encode("ascii")
        try:
            places, kept_bytes = _read_back(self.path, header, kind)
            self._file: BinaryIO = self.path.open("r+b" if kept_bytes else "wb")
            self._file.truncate(kept_bytes)
            self._file.seek(kept_bytes)
            if not kept_bytes:
                self._write(header)
            self._finished = _Finished(self.path, kind, places)
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror or error}") from error

    @property
    def finished(self) -> Mapping[str, T]:
        """Entries by frame name, finished before or appended since; each read when asked for."""
        return self._finished

    def append(self, entry: T) -> None:
        """Add a finished frame; it survives the death of the process from here on.

        Raises:
            OutputError: the journal cannot be written (say, a full disk).
        """
        line = _sealed(self._kind.encode(entry))
        try:
            start = self._file.tell()
            self._write(line)
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror or error}") from error
        self._finished.places[self._kind.frame_name(entry)] = _Place(start, len(line))

    def close(self) -> None:
        """Close the file and keep it for the next run.

        Closing tries once more to write what a full disk refused: that was reported when it arose.
        """
        self._finished.close()
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


class _Place(NamedTuple):
    """Where a line lies in the file."""

    start: int
    length: int


class _Finished(Mapping[str, T]):
    """The entries of a journal, decoded when they are asked for."""

    def __init__(self, path: Path, kind: JournalKind[T], places: dict[str, _Place]) -> None:
        """Open the file for reading beside the one who writes it."""
        self.places = places
        self._path, self._kind = path, kind
        self._file: BinaryIO = path.open("rb", buffering=0)

    def __getitem__(self, name: str) -> T:
        """Return the entry of a frame.

        Raises:
            KeyError: it is not finished.
            OutputError: its line was changed since it was written.
        """
        place = self.places[name]
        try:
            self._file.seek(place.start)
            return self._kind.decode(_content(self._file.read(place.length)))
        except (OSError, ValueError) as error:
            raise OutputError(
                f"{self._path} can no longer be read ({error}); give the same command again"
            ) from error

    def __iter__(self) -> Iterator[str]:
        """Yield the names of frames in the order of the file."""
        return iter(self.places)

    def __len__(self) -> int:
        """Return how many frames are finished."""
        return len(self.places)

    def close(self) -> None:
        """Close the file: nothing can be read any more."""
        self._file.close()


def _sealed(text: str) -> bytes:
    """Return a line with its checksum and end."""
    content = text.encode("ascii")
    return b"%s\t%08x\n" % (content, zlib.crc32(content))


def _content(line: bytes) -> bytes:
    """Return what :func:`_sealed` was given.

    Raises:
        ValueError: the line is torn or damaged.
    """
    content, _, seal = line.rpartition(b"\t")
    if seal != b"%08x\n" % zlib.crc32(content):
        raise ValueError("a line is torn or damaged")
    return content


def _read_back(path: Path, header: bytes, kind: JournalKind[T]) -> tuple[dict[str, _Place], int]:
    """Return places of finished entries by frame name, and where the last one ends."""
    try:
        with path.open("rb") as file:
            if file.readline() != header:
                LOGGER.warning("%s belongs to other inputs or arguments and is discarded", path)
                return {}, 0
            places, damaged = _places(file, len(header), kind)
    except FileNotFoundError:
        return {}, 0
    if damaged:
        LOGGER.warning("%s: %d damaged lines, whose frames are computed anew", path, damaged)
    LOGGER.info("%d finished frames are taken over from %s", len(places), path)
    return places, max(
        (place.start + place.length for place in places.values()), default=len(header)
    )


def _places(
    lines: Iterable[bytes], start: int, kind: JournalKind[T]
) -> tuple[dict[str, _Place], int]:
    """Return where good lines lie by frame name, and how many whole lines are damaged."""
    places: dict[str, _Place] = {}
    damaged = 0
    for line in lines:
        try:
            places[kind.frame_name(kind.decode(_content(line)))] = _Place(start, len(line))
        except ValueError:
            damaged += line.endswith(b"\n")
        start += len(line)
    return places, damaged
