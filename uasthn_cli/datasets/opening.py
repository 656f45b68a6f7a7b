"""Open a source of pairs by what lies there."""

from collections.abc import Iterable
from glob import glob
from pathlib import Path
from typing import Final

from uasthn_cli.datasets.flights import PARTS, FlightDataset, is_flight
from uasthn_cli.datasets.overhead import open_sites
from uasthn_cli.datasets.pairs import PairsDataset, has_pair_columns
from uasthn_cli.datasets.rendered import RenderedDataset
from uasthn_cli.datasets.samples import MatchDataset
from uasthn_cli.datasets.spec import DatasetSpec
from uasthn_cli.errors import DatasetError

IMAGE_SUFFIXES: Final = frozenset({".tif", ".tiff", ".png", ".jpg", ".jpeg"})

_KINDS: Final = (
    f"a flight ({', '.join(PARTS)}), Boson-nighttime (*_queries.h5), a table of pairs (.csv) or"
    " overhead images"
)


def open_dataset(source: str, spec: DatasetSpec) -> MatchDataset:
    """Open a folder, file or glob pattern as what it holds.

    A folder with ``flight.tlog``, ``frames/``, ``map.tif`` and ``truth.csv`` is a flight; one with
    ``*_queries.h5`` Boson-nighttime; a CSV table with the columns of pairs, or a folder with one
    such table, pairs; any other images are overhead images whose thermal views are rendered.

    Raises:
        DatasetError: there is nothing there, or nothing of a known layout.
        UasthnError: what is there cannot be read.
    """
    path = Path(source).expanduser()
    if path.is_dir():
        return _open_folder(path, spec)
    if path.suffix.lower() == ".csv":
        return PairsDataset(path, spec)
    names = [str(path)] if path.is_file() else sorted(glob(str(path), recursive=True))  # noqa: PTH207 (may be absolute)
    images = _images(Path(name) for name in names)
    if not images:
        raise DatasetError(f"{source}: there is no such file or folder; expected {_KINDS}")
    return RenderedDataset(open_sites(images, spec.gsd_m), spec)


def _images(paths: Iterable[Path]) -> list[Path]:
    """Return the files that are images by their names, in order."""
    return sorted(path for path in paths if path.suffix.lower() in IMAGE_SUFFIXES)


def _open_folder(folder: Path, spec: DatasetSpec) -> MatchDataset:
    if is_flight(folder):
        return FlightDataset(folder, spec)
    if any(folder.glob("*_queries.h5")):
        # h5py is an extra: other sources do without
        from uasthn_cli.datasets.boson import BosonDataset  # noqa: PLC0415

        return BosonDataset(folder, spec)
    tables = [table for table in sorted(folder.glob("*.csv")) if has_pair_columns(table)]
    if len(tables) > 1:
        raise DatasetError(f"{folder} holds several tables of pairs: name one, say {tables[0]}")
    if tables:
        return PairsDataset(tables[0], spec)
    images = _images(folder.iterdir())
    if not images:
        missing = [part for part in PARTS if not (folder / part).exists()]
        seen = (
            f"; of a flight, {', '.join(missing)} is missing" if len(missing) < len(PARTS) else ""
        )
        raise DatasetError(f"{folder} is no data set: expected {_KINDS}{seen}")
    return RenderedDataset(open_sites(images, spec.gsd_m), spec)
