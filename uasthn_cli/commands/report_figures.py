"""The pictures of ``uasthn report --figures``: which files they become, and writing them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import click

from uasthn_cli.commands.console import say
from uasthn_cli.errors import OutputError
from uasthn_cli.outputs.atomic import write_files
from uasthn_cli.report.figures import NEEDS, draw_run
from uasthn_cli.report.load import RunResults, single_frame_run


@dataclass(frozen=True, slots=True)
class FigureFolder:
    """Where pictures go, and how: ``file_format`` is ``png`` or ``svg``."""

    folder: Path
    file_format: str
    overwrite: bool = False

    def write(
        self, folders: Sequence[Path], runs: Sequence[RunResults], tolerance_m: float
    ) -> None:
        """Draw runs, ``folders`` being where they came from, and write all pictures or none.

        Raises:
            OutputError: a picture exists already, or cannot be written.
        """
        stems = dict(_stems(folders, runs))
        self._refuse_to_replace([self._path(stem, name) for stem in stems for name in NEEDS])
        files = []
        for stem, run in stems.items():
            for name, content in draw_run(run, tolerance_m, self.file_format).items():
                if content is None:
                    click.echo(f"{run.name}: no {name} figure, it needs {NEEDS[name]}", err=True)
                else:
                    files.append((self._path(stem, name), content))
        if files:
            self._make()
            write_files(files)
        say(f"{len(files)} figures in {self.folder}")

    def _path(self, stem: str, name: str) -> Path:
        """Return the file of a figure."""
        return self.folder / f"{stem}-{name}.{self.file_format}"

    def _refuse_to_replace(self, paths: Sequence[Path]) -> None:
        """Refuse to replace what is there unless that was asked for."""
        existing = [path for path in paths if path.exists()]
        if existing and not self.overwrite:
            raise OutputError(f"{existing[0]} exists already: --overwrite replaces it")

    def _make(self) -> None:
        """Make the folder if it is not there."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot make {self.folder}: {error.strerror or error}") from error


def _stems(folders: Sequence[Path], runs: Sequence[RunResults]) -> Iterator[tuple[str, RunResults]]:
    """Yield how the files of each run begin: its folder's own name, numbered where needed."""
    taken: set[str] = set()
    for folder, run in zip(folders, runs, strict=True):
        own_name = folder.resolve().name
        stem, number = own_name, 1
        while stem in taken:
            number += 1
            stem = f"{own_name}-{number}"
        taken.add(stem)
        yield stem, run
        single = single_frame_run(run)
        if single is not None:
            yield f"{stem}-single", single
