"""Map features on disk, for the next flight over the same ground.

An entry is named by a hash of the map's whole content and the place of the tile, or, where a map is
too large for that or its pixels lie in other files, of the very pixels that were encoded; and of
whoever encoded them and how they were cut. No map is ever recognised by its name, size or time of
change: whatever becomes of the file or its overviews, other content has another name.

A folder may be shared: entries come into place whole, by a rename, and equal names mean equal
content. Each carries a checksum, and what does not match it is computed anew. A folder that cannot
be written, or a full disk, costs the time saved and nothing else.
"""

import contextlib
import hashlib
import logging
import os
import secrets
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.config import MAX_CACHE_BYTES
from uasthn_cli.types import MapWindow

_log = logging.getLogger(__name__)

_MAGIC: Final = b"uasthn-features-1\n"
_HEADER: Final = struct.Struct("<18s3I32s")
"""Magic, shape ``(channels, rows, columns)``, SHA-256 of name, shape and values."""

_VALUES_AT: Final = 64
_VALUE: Final = np.dtype("<f2")
_SUFFIX: Final = ".features"
_TEMPORARY_SUFFIX: Final = ".features.tmp"
_ABANDONED_S: Final = 3600.0
_SHARING: Final = 8
"""As many processes may write at a time without exceeding the bound together."""
_SPARE: Final = 16
"""Where something must go, this part of the store goes at once."""


def window_key(window: MapWindow, made_by: str) -> str:
    """Return the name of what ``made_by`` makes of a window: equal names mean equal features.

    ``made_by`` says all that shapes features apart from the window's pixels, mask, resolution and
    the map's statistics; where the window lies does not.
    """
    hashed = hashlib.sha256(_MAGIC)
    about = (made_by, window.image.shape, window.grid.gsd_m, window.statistics)
    hashed.update(repr(about).encode())
    for array in (window.image, window.valid):
        hashed.update(np.ascontiguousarray(array).data)
    return hashed.hexdigest()


def place_key(about: str) -> str:
    """Return the name of a tile of a known map: ``about`` says all that shapes its features."""
    return hashlib.sha256(_MAGIC + about.encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class _Entry:
    """A file of the store: when it was last used, and its size."""

    used_ns: int
    path: Path
    size_bytes: int


class FeatureStore:
    """A folder of features by name, the least recently used removed; safe to share.

    Several processes may use one folder at the same time.
    """

    def __init__(self, folder: Path, max_bytes: int = MAX_CACHE_BYTES) -> None:
        """Keep at most ``max_bytes`` in a folder, which is made when first needed."""
        self._folder, self._max_bytes = folder, max_bytes
        self._is_writable = self._is_readable = True
        self._granted_bytes = 0

    def get(self, key: str) -> NDArray[np.float16] | None:
        """Return features ``(channels, rows, columns)`` by name, or None if not there whole."""
        path = self._path(key)
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            self._give_up_reading(error)
            return None
        values = _unpacked(key, content)
        if values is None:
            _log.info("%s is damaged; its features are computed anew", path)
            return None
        with contextlib.suppress(OSError):  # a folder that is only read keeps its order
            os.utime(path)
        return values

    def put(self, key: str, values: NDArray[np.float16]) -> None:
        """Keep features ``(channels, rows, columns)``; after a first failure nothing is written."""
        if not self._is_writable:
            return
        content = _packed(key, values)
        if len(content) > self._max_bytes:
            return
        path = self._path(key)
        temporary = path.with_name(f".{key}.{secrets.token_hex(8)}{_TEMPORARY_SUFFIX}")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._make_room(len(content))
            try:
                temporary.write_bytes(content)
                temporary.replace(path)
            except OSError:
                _discard(temporary)
                raise
        except OSError as error:
            self._give_up_writing(error)

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}{_SUFFIX}"

    def _make_room(self, needed_bytes: int) -> None:
        """Remove what was not used for longest until there is room, and what killed runs left.

        The folder is looked through once for many entries: what is free then is shared with other
        processes, and this one takes a part of it before it looks again.
        """
        if needed_bytes <= self._granted_bytes:
            self._granted_bytes -= needed_bytes
            return
        entries = sorted(self._entries(), key=lambda entry: (entry.used_ns, entry.path.name))
        free_bytes = self._max_bytes - needed_bytes - sum(entry.size_bytes for entry in entries)
        spare_bytes = self._max_bytes // _SPARE
        for entry in entries:
            if free_bytes >= 0 and free_bytes + entry.size_bytes > spare_bytes:
                break
            _discard(entry.path)
            free_bytes += entry.size_bytes
        self._granted_bytes = min(free_bytes, spare_bytes) // _SHARING

    def _entries(self) -> Iterator[_Entry]:
        """Yield the store's own files, without those that are being written."""
        abandoned_ns = time.time_ns() - int(_ABANDONED_S * 1e9)
        with os.scandir(self._folder) as files:
            for file in files:
                is_temporary = file.name.endswith(_TEMPORARY_SUFFIX)
                if not (is_temporary or file.name.endswith(_SUFFIX)):
                    continue
                try:
                    status = file.stat()
                except OSError:  # removed by another process
                    continue
                if not is_temporary:
                    yield _Entry(status.st_mtime_ns, Path(file.path), status.st_size)
                elif status.st_mtime_ns < abandoned_ns:
                    _discard(Path(file.path))

    def _give_up_reading(self, error: OSError) -> None:
        if self._is_readable:
            self._is_readable = False
            _log.warning("features of %s cannot be read: %s", self._folder, _words(error))

    def _give_up_writing(self, error: OSError) -> None:
        self._is_writable = False
        _log.warning(
            "map features are not kept for later runs: %s: %s", self._folder, _words(error)
        )


@lru_cache(maxsize=8)
def open_store(folder: Path) -> FeatureStore:
    """Return the one store of a folder in this process, which warns once if it must."""
    _log.info("map features are kept in %s", folder)
    return FeatureStore(folder)


def default_cache_dir() -> Path:
    """Return the user's own folder for features: ``XDG_CACHE_HOME`` or ``~/.cache``."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "uasthn" / "features"


def _packed(key: str, values: NDArray[np.float16]) -> bytes:
    content = np.ascontiguousarray(values, dtype=_VALUE).tobytes()
    channels, rows, columns = values.shape
    header = _HEADER.pack(
        _MAGIC, channels, rows, columns, _checksum(key, (channels, rows, columns), content)
    )
    return header.ljust(_VALUES_AT, b"\0") + content


def _unpacked(key: str, content: bytes) -> NDArray[np.float16] | None:
    """Return the values of an entry, or None if it is not what was written under this name."""
    if len(content) < _VALUES_AT:
        return None
    magic, channels, rows, columns, checksum = _HEADER.unpack_from(content)
    shape, values = (channels, rows, columns), memoryview(content)[_VALUES_AT:]
    if magic != _MAGIC or channels * rows * columns * _VALUE.itemsize != len(values):
        return None
    if _checksum(key, shape, values) != checksum:
        return None
    return np.frombuffer(values, dtype=_VALUE).reshape(shape)


def _checksum(key: str, shape: tuple[int, int, int], values: bytes | memoryview) -> bytes:
    hashed = hashlib.sha256(repr((key, shape)).encode())
    hashed.update(values)
    return hashed.digest()


def _discard(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink(missing_ok=True)


def _words(error: OSError) -> str:
    return error.strerror or str(error)
