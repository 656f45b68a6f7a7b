"""``uasthn report``: summarise finished runs, compare them, and gate on them."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from uasthn_cli.commands.console_tables import print_table
from uasthn_cli.commands.parameter_types import ABOVE_ZERO, FiniteRange
from uasthn_cli.commands.sections import SectionedCommand, section_option
from uasthn_cli.config import TOLERANCE_M
from uasthn_cli.errors import GateMissedError

if TYPE_CHECKING:
    from uasthn_cli.report.load import RunResults
    from uasthn_cli.report.render import ReportColumn

_FRACTION: Final = FiniteRange(min=0, max=1)

_EXAMPLES: Final = """\
\b
What did the wider search gain, and what over the GPS alone?
  uasthn report out/radius200 out/radius450 --baseline prior
Which signals of uncertainty tell wrong answers from good ones, in numbers and pictures?
  uasthn report out/today --trust --figures out/today_figures
In cron: keep the figures, speak up only when the flight went badly
(a gate that needs truth is missed by a run without):
  uasthn report out/today --json --min-accepted 0.5 --max-ce 25 > today.json
"""

figure_option = section_option("Figures")
picture_option = section_option("Pictures (need `pip install 'uasthn[figures]'`)")
gate_option = section_option("Gates (exit code 4 when one is missed)")


@click.command(
    cls=SectionedCommand, epilog=_EXAMPLES, short_help="Summarise and compare finished runs; gates."
)
@click.argument(
    "folders", metavar="DIR...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@figure_option("--json", "as_json", is_flag=True, help="Print a JSON list, one object per DIR.")
@figure_option(
    "--tolerance-m",
    type=ABOVE_ZERO,
    default=TOLERANCE_M,
    show_default=True,
    metavar="METRES",
    help="CE up to which a frame counts as found.",
)
@figure_option(
    "--baseline",
    type=click.Choice(["prior"]),
    help="Show beside each run what the GPS prior alone would have given on the same frames:"
    " the distance of its camera position from the true one.",
)
@figure_option(
    "--trust",
    "with_trust",
    is_flag=True,
    help="Show also how well the stated uncertainties tell wrong answers: area under the ROC (AUC)"
    " and under the risk-coverage curve (AURC) per signal, calibration error of the predicted risk."
    " --json always has them.",
)
@picture_option(
    "--figures",
    "figures_folder",
    type=click.Path(path_type=Path),
    metavar="OUTDIR",
    help="Draw risk-coverage, ROC, reliability and errors of each run into this folder.",
)
@picture_option(
    "--figure-format",
    type=click.Choice(["png", "svg"]),
    default="png",
    show_default=True,
    help="Format of the pictures.",
)
@picture_option("--overwrite", is_flag=True, help="Replace pictures that are in OUTDIR.")
@gate_option(
    "--min-accepted",
    type=_FRACTION,
    metavar="SHARE",
    help="Least accepted fraction of all frames.",
)
@gate_option(
    "--max-ce",
    type=ABOVE_ZERO,
    metavar="METRES",
    help="Largest median CE of accepted frames.",
)
@gate_option(
    "--min-within25",
    type=_FRACTION,
    metavar="SHARE",
    help="Least share of accepted frames with a CE of at most 25 m, whatever --tolerance-m says.",
)
@gate_option(
    "--max-risk",
    type=_FRACTION,
    metavar="SHARE",
    help="Largest share of accepted frames with a CE beyond --tolerance-m.",
)
@gate_option(
    "--min-ce90-coverage",
    type=_FRACTION,
    metavar="SHARE",
    help="Least share of accepted frames with a CE within their predicted CE90; 0.9 if the"
    " prediction is right.",
)
def report(
    folders: tuple[Path, ...],
    as_json: bool,
    tolerance_m: float,
    baseline: str | None,
    with_trust: bool,
    figures_folder: Path | None,
    figure_format: str,
    overwrite: bool,
    min_accepted: float | None,
    max_ce: float | None,
    min_within25: float | None,
    max_risk: float | None,
    min_ce90_coverage: float | None,
) -> None:
    """Summarise finished runs: DIR is what `uasthn geotag --out` wrote.

    Shows frames, accepted fraction (the paper's success rate) and reasons. Runs with --truth also
    show CE, the distance of the frame centre from the truth, MACE, the mean distance of its four
    corners, camera CE, that of the camera where the truth has it, and shares: of frames within the
    tolerance (of all, where one without an estimate counts as not within, and of the accepted
    ones), and of errors within the CE90 that was stated. Several runs stand side by side.
    """
    from uasthn_cli.report.gates import Gates, missed_gates

    figures = None
    if figures_folder is not None:  # before anything is printed: it may lack matplotlib
        from uasthn_cli.commands.report_figures import FigureFolder

        figures = FigureFolder(figures_folder, figure_format, overwrite)
    runs = print_report(folders, tolerance_m, baseline == "prior", as_json, with_trust)
    if figures is not None:
        figures.write(folders, runs, tolerance_m)
    gates = Gates(min_accepted, max_ce, min_within25, max_risk, min_ce90_coverage)
    missed = [phrase for run in runs for phrase in missed_gates(run, gates, tolerance_m)]
    if missed:
        raise GateMissedError("; ".join(missed))


def print_report(
    folders: Sequence[Path],
    tolerance_m: float,
    with_prior: bool,
    as_json: bool = False,
    with_trust: bool = False,
) -> "list[RunResults]":
    """Print results folders side by side on stdout and return them.

    Raises:
        ResultsError: a folder holds no finished run.
    """
    from uasthn_cli.report.load import load_run
    from uasthn_cli.report.render import (
        INTERVALS_IN_WORDS,
        reasons_in_words,
        report_json,
        report_table,
    )

    runs = [load_run(folder) for folder in folders]
    columns = [_column(run, tolerance_m, with_prior) for run in runs]
    if as_json:
        click.echo(report_json(columns))
    else:
        print_table(report_table(columns, with_trust))
        for line in (INTERVALS_IN_WORDS, *reasons_in_words(columns)):
            click.echo(line)
    return runs


def _column(run: "RunResults", tolerance_m: float, with_prior: bool) -> "ReportColumn":
    """Judge one run; on stderr, say that a baseline was asked for and cannot be had."""
    from uasthn_cli.report.baseline import prior_accuracy
    from uasthn_cli.report.load import single_frame_run
    from uasthn_cli.report.metrics import summarise
    from uasthn_cli.report.render import ReportColumn
    from uasthn_cli.report.trust_summary import summarise_trust

    prior = prior_accuracy(run, tolerance_m) if with_prior else None
    if with_prior and prior is None:
        click.echo(f"{run.name}: no baseline, there are no true camera positions", err=True)
    single = single_frame_run(run)
    return ReportColumn(
        name=run.name,
        version=run.version,
        summary=summarise(run, tolerance_m),
        prior=prior,
        trust=summarise_trust(run, tolerance_m),
        single=_column(single, tolerance_m, with_prior=False) if single else None,
    )
