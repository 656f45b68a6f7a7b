"""How soon networks learn: the error of `uasthn train` against samples seen and against time.

    python benchmarks/training_curves.py NAME=LOG.log.csv[:VIEWS_A_STEP] … --out out/curves

Reads the logs that lie beside trained weights. Errors are those of the batches learnt from, which
no batch repeats, in pixels of the network's own working width: compare a curve with its beginning,
and `xcorr` (which scores every shift, at 96 px) with the others (256 px) by shape alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import pandas as pd
from tables import markdown_table, number

from uasthn_cli.outputs.atomic import write_bytes, write_text
from uasthn_cli.report.drawing import Axes, Figure, encode, styled

COLUMNS = (
    "network",
    "steps",
    "samples",
    "minutes",
    "first error px",
    "last error px",
    "validation px",
)
_STYLES = (
    ("#0072B2", "-"),
    ("#D55E00", "--"),
    ("#009E73", "-."),
    ("#CC79A7", ":"),
    ("#000000", "-"),
)


@dataclass(frozen=True, slots=True)
class Curve:
    """One training run; ``views_a_step`` is how many thermal images a step learns from."""

    name: str
    log: pd.DataFrame
    views_a_step: int

    def row(self) -> list[str]:
        """Return a line of the table."""
        last = self.log.iloc[-1]
        judged = self.log["validation_median_error_px"].dropna()
        return [
            self.name,
            str(int(last["step"])),
            str(int(last["step"]) * self.views_a_step),
            number(last["seconds"] / 60.0, 1),
            number(self.log["median_error_px"].iloc[0], 1),
            number(last["median_error_px"], 1),
            number(judged.iloc[-1] if len(judged) else None, 1),
        ]


def read_curve(argument: str) -> Curve:
    """Return the run of ``NAME=LOG[:VIEWS]``.

    Raises:
        click.BadParameter: it is not that, or not a log.
    """
    name, _, rest = argument.partition("=")
    path, _, views = rest.partition(":")
    try:
        log = pd.read_csv(path)
        return Curve(
            name,
            log[["step", "seconds", "median_error_px", "validation_median_error_px"]],
            int(views or 1),
        )
    except (OSError, ValueError, KeyError) as error:
        raise click.BadParameter(f"{argument}: {error}") from error


def draw(curves: Sequence[Curve], file_format: str) -> bytes:
    """Return the figure: error against samples, and against minutes."""
    with styled():
        figure = Figure(figsize=(11.0, 4.4), layout="constrained")
        by_samples, by_time = figure.subplots(1, 2, sharey=True)
        for curve, (color, linestyle) in zip(curves, _STYLES * len(curves), strict=False):
            log, style = curve.log, {"color": color, "linestyle": linestyle}
            error_px = log["median_error_px"]
            by_samples.plot(log["step"] * curve.views_a_step, error_px, label=curve.name, **style)
            by_time.plot(log["seconds"] / 60.0, error_px, label=curve.name, **style)
        _label(by_samples, "thermal images learnt from", "log")
        _label(by_time, "minutes of one core", "linear")
        by_samples.set_ylabel("median error [px]")
        by_time.legend(loc="best", fontsize=9.0)
        content = encode(figure, file_format)
        assert content is not None
        return content


def _label(axes: Axes, what: str, scale: str) -> None:
    axes.set_xlabel(what)
    axes.set_xscale(scale)
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")


@click.command()
@click.argument("logs", nargs=-1, required=True, metavar="NAME=LOG[:VIEWS]…")
@click.option("--out", type=click.Path(path_type=Path), required=True)
def main(logs: tuple[str, ...], out: Path) -> None:
    """Draw training curves."""
    curves = [read_curve(argument) for argument in logs]
    out.mkdir(parents=True, exist_ok=True)
    for file_format in ("png", "svg"):
        write_bytes(out / f"training.{file_format}", draw(curves, file_format))
    table = markdown_table(COLUMNS, [curve.row() for curve in curves])
    write_text(out / "training.md", table + "\n")
    click.echo(table)


if __name__ == "__main__":
    main()
