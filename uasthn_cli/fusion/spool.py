"""Sequences that lie in a temporary file and are read one entry at a time: memory holds none."""

import errno
import tempfile
import weakref
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from typing import Generic, Self, TypeVar, overload

import numpy as np
import numpy.typing as npt

from uasthn_cli.errors import OutputError
from uasthn_cli.types import FloatArray, OffsetLikelihood

T = TypeVar("T")
Scalar = TypeVar("Scalar", bound=np.generic)


class ReadOnDemand(Sequence[T]):
    """A sequence whose entries are made when they are asked for."""

    @overload
    def __getitem__(self, index: int) -> T: ...

    @overload
    def __getitem__(self, index: slice) -> list[T]: ...

    def __getitem__(self, index: int | slice) -> T | list[T]:
        """Return one entry, or several as a list."""
        places = range(len(self))
        if isinstance(index, slice):
            return [self._entry(place) for place in places[index]]
        return self._entry(places[index])

    @abstractmethod
    def _entry(self, place: int) -> T:
        """Return the entry at ``place``, which is within the sequence."""


class Spool(ReadOnDemand[npt.NDArray[Scalar]], Generic[Scalar]):
    """Arrays of one shape and type.

    The file lies where :mod:`tempfile` puts it (``TMPDIR``) and goes when nobody holds the spool
    any more, whatever ends the process. It is read, not mapped: what is mapped counts as memory.
    """

    def __init__(self, shape: tuple[int, ...], dtype: type[Scalar]) -> None:
        """Open an empty file.

        Raises:
            OutputError: there is no place for it.
        """
        self._shape, self._dtype, self._count = shape, np.dtype(dtype), 0
        self._bytes = int(np.prod(shape)) * self._dtype.itemsize
        try:
            self._file = tempfile.TemporaryFile(prefix="uasthn-", buffering=0)  # noqa: SIM115
        except OSError as error:
            raise _no_room(error) from error
        weakref.finalize(self, self._file.close)

    def __len__(self) -> int:
        """Return how many arrays there are."""
        return self._count

    def append(self, values: npt.NDArray[Scalar]) -> None:
        """Add an array.

        Raises:
            OutputError: the disk is full.
        """
        self._write(self._count, values)
        self._count += 1

    def replace(self, place: int, values: npt.NDArray[Scalar]) -> None:
        """Write an array over another.

        Raises:
            OutputError: the disk is full.
        """
        self._write(range(self._count)[place], values)

    def _entry(self, place: int) -> npt.NDArray[Scalar]:
        values = np.empty(self._shape, self._dtype)
        self._file.seek(place * self._bytes)
        if self._file.readinto(values.data.cast("B")) != self._bytes:
            raise OutputError(f"a temporary file in {tempfile.gettempdir()} was cut short")
        return values

    def _write(self, place: int, values: npt.NDArray[Scalar]) -> None:
        content = np.ascontiguousarray(values, self._dtype)
        assert content.shape == self._shape, "a spool holds arrays of one shape"
        try:
            self._file.seek(place * self._bytes)
            if self._file.write(content.data.cast("B")) != self._bytes:
                raise OSError(errno.ENOSPC, "No space left on device")
        except OSError as error:
            raise _no_room(error) from error


class LikelihoodSpool(ReadOnDemand[OffsetLikelihood | None]):
    """Likelihoods of one size and cell; None for a frame that says nothing, which costs nothing."""

    def __init__(self, likelihoods: Iterable[OffsetLikelihood | None] = ()) -> None:
        """Take over likelihoods one by one."""
        self._levels: Spool[np.uint8] | None = None
        self._cell_m = 0.0
        self._centres_m: list[FloatArray] = []
        self._places: list[int | None] = []
        for likelihood in likelihoods:
            self.append(likelihood)

    def __len__(self) -> int:
        """Return how many frames there are."""
        return len(self._places)

    @property
    def says_anything(self) -> bool:
        """Tell whether any frame has a likelihood."""
        return self._levels is not None

    def append(self, likelihood: OffsetLikelihood | None) -> None:
        """Add what a frame says.

        Raises:
            OutputError: the disk is full.
        """
        if likelihood is None:
            self._places.append(None)
            return
        if self._levels is None:
            self._levels = Spool(likelihood.levels.shape, np.uint8)
            self._cell_m = likelihood.cell_m
        self._places.append(len(self._levels))
        self._levels.append(likelihood.levels)
        self._centres_m.append(likelihood.centre_m)

    def in_order(self, order: Sequence[int]) -> Self:
        """Return the same likelihoods in another order, in the same file."""
        other = type(self)()
        other._levels, other._cell_m = self._levels, self._cell_m
        other._centres_m = self._centres_m
        other._places = [self._places[place] for place in order]
        return other

    def _entry(self, place: int) -> OffsetLikelihood | None:
        stored = self._places[place]
        if stored is None or self._levels is None:
            return None
        return OffsetLikelihood(self._levels[stored], self._cell_m, self._centres_m[stored])


def _no_room(error: OSError) -> OutputError:
    return OutputError(
        f"cannot write temporary data to {tempfile.gettempdir()}: {error.strerror or error};"
        " TMPDIR names another place"
    )
