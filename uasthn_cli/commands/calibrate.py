"""``uasthn calibrate``: finished runs with known positions in, a promise about risk out."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from uasthn_cli.commands.options import output_option
from uasthn_cli.commands.parameter_types import ABOVE_ZERO, FiniteRange
from uasthn_cli.commands.sections import SectionedCommand, section_option
from uasthn_cli.config import CONFIDENCE_LEVEL, TARGET_RISK, TOLERANCE_M
from uasthn_cli.errors import OutputError

if TYPE_CHECKING:
    from uasthn_cli.calibration.load import GpsStretch
    from uasthn_cli.uncertainty.calibration import Calibration, Judgement

_EXAMPLES: Final = """\
\b
From flights whose true positions are known (rendered by `uasthn synth`, or surveyed):
  uasthn geotag a.tlog a/ --map map.tif --hfov 45 --truth a.csv --out out/a
  uasthn geotag b.tlog b/ --map map.tif --hfov 45 --truth b.csv --out out/b
  uasthn calibrate out/a out/b --out calibration.json
  uasthn geotag new.tlog new/ --map map.tif --hfov 45 \\
      --calibration calibration.json --out out/new
\b
From the part of your own flight before GPS was jammed:
  uasthn calibrate out/flight --from-gps 2025-11-22T08:40:00Z..2025-11-22T08:52:00Z \\
      --out calibration.json
"""

_SHARE: Final = FiniteRange(0, 1, min_open=True, max_open=True)
_AT_LEAST_1: Final = click.IntRange(min=1)

promise_option = section_option("Promise")
frames_option = section_option("Frames")


class StretchType(click.ParamType["GpsStretch"]):
    """A stretch of time, ``START..END`` in UTC with either end left out, or ``all``."""

    name = "all|START..END"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> "GpsStretch":
        """Return the stretch."""
        from uasthn_cli.calibration.load import GpsStretch

        if isinstance(value, GpsStretch):
            return value
        if value == "all":
            return GpsStretch()
        start, separator, end = str(value).partition("..")
        if not separator or not (start or end):
            self.fail(f"{value!r} is neither 'all' nor START..END", param, ctx)
        unbounded = GpsStretch()
        stretch = GpsStretch(
            self._seconds(start, param, ctx) if start else unbounded.start_utc_s,
            self._seconds(end, param, ctx) if end else unbounded.end_utc_s,
        )
        if not stretch.start_utc_s < stretch.end_utc_s:
            self.fail(f"{value!r} ends before it begins", param, ctx)
        return stretch

    def _seconds(
        self, text: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        from uasthn_cli.ingest.timestamps import parse_time

        stated = parse_time(text)
        if stated is None:
            self.fail(f"{text!r} is no time such as 2025-11-22T08:40:00Z", param, ctx)
        return stated.time_s


@click.command(
    cls=SectionedCommand,
    epilog=_EXAMPLES,
    short_help="Choose what to accept from frames whose positions are known.",
)
@click.argument(
    "folders", metavar="RESULTS_DIR...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@promise_option(
    "--risk",
    "target_risk",
    type=_SHARE,
    default=TARGET_RISK,
    show_default=True,
    metavar="SHARE",
    help="Largest share of accepted frames beyond the tolerance.",
)
@promise_option(
    "--confidence",
    "confidence_level",
    type=_SHARE,
    default=CONFIDENCE_LEVEL,
    show_default=True,
    metavar="SHARE",
    help="How sure the promise is: of so many calibrations made like this, this share keep it.",
)
@promise_option(
    "--tolerance-m",
    type=ABOVE_ZERO,
    default=TOLERANCE_M,
    show_default=True,
    metavar="METRES",
    help="CE up to which a frame counts as right.",
)
@promise_option(
    "--unit",
    type=click.Choice(["auto", "flight", "frame"]),
    default="auto",
    show_default=True,
    help="What the promise is about: the mean over flights like these (each RESULTS_DIR is one), or"
    " frames, taken as independent, which those of one flight are not. auto: flights where there"
    " are enough to certify the risk.",
)
@frames_option(
    "--from-gps",
    "gps",
    type=StretchType(),
    help="Take the logged GPS position as truth, of all frames or from START to END (UTC), where"
    " you know that it was good. Compared are camera positions, so GPS's own error, the attitude's"
    " and the map's count as errors of the answer.",
)
@frames_option(
    "--thin",
    type=_AT_LEAST_1,
    default=1,
    show_default=True,
    metavar="N",
    help="Use every N-th frame of each flight only. Neighbouring frames are often right or wrong"
    " together, which makes the promise weaker than it says; thinned ones less so.",
)
@frames_option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="N",
    help="Deals flights (frames, if there is only one) to the two halves.",
)
@output_option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    metavar="FILE.json",
    help="The calibration, for `uasthn geotag --calibration`.",
)
@output_option("--overwrite", is_flag=True, help="Replace the file if it is there.")
def calibrate(
    folders: tuple[Path, ...],
    target_risk: float,
    confidence_level: float,
    tolerance_m: float,
    unit: str,
    gps: "GpsStretch | None",
    thin: int,
    seed: int,
    out: Path,
    overwrite: bool,
) -> None:
    """Choose which answers to accept, so that few of them are wrong.

    RESULTS_DIR is what `uasthn geotag --truth --out` wrote (without --truth: see --from-gps). On
    one part of the flights a model learns from the answers' signals how likely each is beyond the
    tolerance; on the other part the laxest threshold is chosen for which a test says, with the
    stated confidence, that no more than the stated share of accepted frames is beyond it. The same
    part tells how predicted 90 % radii (CE90) of accepted frames must be scaled to cover 90 % of
    errors. Runs that fuse the flight are calibrated twice, for fused and for single-frame answers.

    The promise is about frames like these: another camera, season or kind of ground needs its own.
    """
    import json

    from uasthn_cli.calibration.load import load_answers
    from uasthn_cli.calibration.run import CalibrationSettings
    from uasthn_cli.calibration.run import calibrate as make_calibration
    from uasthn_cli.outputs.atomic import write_text
    from uasthn_cli.uncertainty.calibration import Unit

    if out.exists() and not overwrite:
        raise OutputError(f"{out}: exists already; give --overwrite or another --out")
    settings = CalibrationSettings(
        *(tolerance_m, target_risk, confidence_level, seed, thin),
        None if unit == "auto" else Unit(unit),
    )
    answers = load_answers(folders, gps)
    calibration = make_calibration(answers, settings, _note(folders, gps, settings.thin, seed))
    write_text(out, json.dumps(calibration.to_json(), indent=2, allow_nan=False) + "\n")
    for line in _table(calibration):
        click.echo(line)
    click.echo(f"Promised: {calibration.promise}")


def _note(folders: Sequence[Path], gps: "GpsStretch | None", thin: int, seed: int) -> str:
    """Return where a calibration came from."""
    from uasthn_cli import __version__

    names = ", ".join(folder.resolve().name for folder in folders)
    truth = "true positions" if gps is None else "logged GPS positions"
    every = f", every {thin}. frame" if thin > 1 else ""
    return f"uasthn {__version__}; {truth} of {names}{every}; seed {seed}"


def _table(calibration: "Calibration") -> list[str]:
    """Return what was chosen, a column per kind of answer."""
    judgements = {"single": calibration.single, "fused": calibration.fused}
    columns = [
        [kind, *_cells(judgement, calibration)]
        for kind, judgement in judgements.items()
        if judgement is not None
    ]
    labels = [
        "answers",
        "signals",
        "frames to fit the model",
        "frames to certify it",
        "accept up to an estimated risk of",
        "accepted fraction of these",
        f"accepted beyond {calibration.tolerance_m:g} m",
        f"certified risk, confidence {calibration.confidence_level:g}",
        "CE90 scale",
    ]
    widths = [max(map(len, column)) for column in columns]
    first = max(map(len, labels))
    return [
        "  ".join([label.ljust(first), *(c.rjust(w) for c, w in zip(cells, widths, strict=True))])
        for label, *cells in zip(labels, *columns, strict=True)
    ]


def _cells(judgement: "Judgement", calibration: "Calibration") -> list[str]:
    """Return the figures of one kind of answer, in the order of the labels."""
    is_certified = judgement.max_risk > 0
    return [
        ", ".join(term.signal for term in judgement.model.terms),
        str(judgement.fit_frames),
        str(judgement.frames),
        f"{judgement.max_risk:.4f}" if is_certified else "-",
        f"{judgement.accepted_fraction:.3f}",
        f"{judgement.errors} of {judgement.accepted}",
        f"<= {calibration.target_risk:g}" if is_certified else "none",
        f"{judgement.ce90_scale:.3f}" if judgement.ce90_frames else "1 (not learned)",
    ]
