"""``uasthn evaluate``: pairs in, predictions out, and the paper's tables and figures of them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from uasthn_cli.commands.console import progress, say
from uasthn_cli.commands.console_tables import print_table
from uasthn_cli.commands.evaluation_options import (
    UeType,
    crop_options,
    data_options,
    estimator_options,
    judging_options,
    refuse_predicting_options,
    stress_option,
    uncertainty_option,
)
from uasthn_cli.commands.options import (
    camera_options,
    out_option,
    output_option,
    overwrite_option,
)
from uasthn_cli.commands.parameter_types import ABOVE_ZERO
from uasthn_cli.commands.sections import SectionedCommand
from uasthn_cli.commands.tgm_drawing import drawn_to_judge_by
from uasthn_cli.config import TOLERANCE_M, CropTtaConfig, UeMethod

if TYPE_CHECKING:
    from uasthn_cli.evaluation.judging import JudgingConfig
    from uasthn_cli.evaluation.predictions import Predictions, Settings
    from uasthn_cli.evaluation.protocol import ProtocolConfig
    from uasthn_cli.ingest.cameras import CameraSpec
    from uasthn_cli.seam import Estimator

_EXAMPLES: Final = """\
\b
Without any data of your own: render a flight, evaluate on its real log and map,
then draw the same predictions with another threshold:
  uasthn synth flights/farms --kind farms --frames 40
  uasthn evaluate flights/farms --hfov 45 --dc 128 --dc 256 --out out/farms
  uasthn evaluate --from out/farms/*.npz --max-std 4px --out out/farms_4px
\b
The paper's Table I with the three networks in the box, on maps with rendered
night views, 1536 m windows:
  uasthn evaluate 'maps/*.tif' --dc 128 --dc 256 --dc 512 --samples 500 \\
      --ensemble --ue none,de,croptta,croptta+de --out out/table
\b
An ablation: one run per setting, then all curves in one figure:
  uasthn evaluate boson/satellite_0_thermalmapping_135 --views 3 --out out/n3
  uasthn evaluate boson/satellite_0_thermalmapping_135 --views 9 --out out/n9
  uasthn evaluate --from out/n3/*.npz out/n9/*.npz --ue croptta --out out/views
\b
What is rejected of the paper's failure cases:
  uasthn evaluate --stress flights/farms --hfov 45 --out out/stress
"""

_RENDERED_FRAMES: Final = 24


@click.command(
    cls=SectionedCommand, epilog=_EXAMPLES, short_help="The paper's evaluation on pairs of images."
)
@click.argument("inputs", metavar="[DATASET | FILE.npz...]", nargs=-1)
@data_options
@camera_options
@estimator_options
@uncertainty_option(
    "--ue",
    "methods",
    type=UeType(),
    help="Rows of the tables: none, de, croptta, croptta+de, dm.  [default: all that the run"
    " allows]",
)
@crop_options
@judging_options
@uncertainty_option(
    "--tolerance-m",
    type=ABOVE_ZERO,
    default=TOLERANCE_M,
    show_default=True,
    metavar="M",
    help="MACE beyond which the ROC expects a rejection, CE up to which a sample counts as found.",
)
@stress_option(
    "--stress",
    "is_stress",
    is_flag=True,
    help="DATASET are flights (rendered if none is given): what is rejected of them in each of the"
    " paper's six failure cases, at three severities.",
)
@output_option(
    "--from",
    "is_from",
    is_flag=True,
    help="Inputs are predictions of earlier runs: draw tables and figures from them.",
)
@out_option("Where predictions, tables and figures go.")
@output_option(
    "--figures/--no-figures",
    "with_figures",
    default=True,
    show_default=True,
    help="Draw ROC, histogram and accepted fraction against MACE as PNG and SVG (need"
    " `pip install 'uasthn[figures]'`).",
)
@overwrite_option
def evaluate(
    inputs: tuple[str, ...],
    methods: "tuple[UeMethod, ...] | None",
    judging: "JudgingConfig",
    tolerance_m: float,
    is_stress: bool,
    is_from: bool,
    out: Path,
    with_figures: bool,
    overwrite: bool,
    **settings: Any,
) -> None:
    """Evaluate an estimator by the paper's protocol, or draw from predictions made before.

    DATASET is told by what is there: a flight with truth (flight.tlog, frames/, map.tif,
    truth.csv), Boson-nighttime (*_queries.h5), a table of pairs (.csv), or overhead images (a
    folder, file or quoted pattern) whose night views are rendered. Each thermal image is sought in
    a satellite window of W_S whose middle is off by up to D_C. All answers are kept in one file per
    D_C, from which tables and figures are drawn; a run that was killed goes on from it.

    MACE is the mean distance of four corners, CE that of the centre, both of accepted samples;
    "accepted" is what the paper calls success rate.
    """
    from uasthn_cli.commands.evaluate_outputs import EvaluationFolder

    folder = EvaluationFolder(out, overwrite, with_figures)
    if is_from:
        if is_stress or not inputs:
            raise click.UsageError("--from needs predictions, and does not go with --stress")
        refuse_predicting_options()
        runs = _loaded(inputs)
    elif is_stress:
        _run_stress(inputs, methods, judging, tolerance_m, folder, settings)
        return
    else:
        if len(inputs) != 1:
            raise click.UsageError("give one DATASET, or predictions with --from")
        runs = _predicted(inputs[0], folder, settings)
    tables = folder.write(runs, methods, judging, tolerance_m)
    for cells in tables:
        print_table(cells)
        click.echo()
    say(f"tables and figures are in {out}")


def _loaded(names: Sequence[str]) -> "list[Predictions]":
    from uasthn_cli.evaluation.predictions import load_predictions

    return [load_predictions(Path(name)) for name in names]


def _predicted(source: str, folder: Any, values: dict[str, Any]) -> "list[Predictions]":
    """Run the protocol for each D_C, each into its own file."""
    from uasthn_cli.datasets.opening import open_dataset
    from uasthn_cli.evaluation.run import predict_to_file

    runs = []
    estimators = _open(values)
    for offset_m in values["offsets_m"] or (None,):
        spec = _spec(values, offset_m)
        dataset = open_dataset(source, spec)
        if values["tgm"] is not None:
            dataset = drawn_to_judge_by(source, dataset, values["tgm"], values["device"])
        settings, config = _settings(source, spec, values)
        name = settings.estimator.replace(":", "-")
        name += "" if offset_m is None else f"-dc{offset_m:g}"
        with progress(name, len(dataset)) as advance:
            run = predict_to_file(
                folder.made() / f"{name}.npz",
                dataset,
                estimators,
                settings,
                config,
                overwrite=folder.overwrite,
                on_sample=advance,
            )
        runs.append(run)
    return runs


def _run_stress(
    inputs: Sequence[str],
    methods: "tuple[UeMethod, ...] | None",
    judging: "JudgingConfig",
    tolerance_m: float,
    folder: Any,
    values: dict[str, Any],
) -> None:
    """Evaluate flights made wrong, and write and print what became of them."""
    from tempfile import TemporaryDirectory

    from uasthn_cli.evaluation.stress import StressSuite, render_flights

    if values["tgm"] is not None:
        raise click.UsageError("--stress takes flights, and --tgm draws views of overhead images")
    offsets_m = values["offsets_m"]
    if len(offsets_m) > 1:
        raise click.UsageError("--stress takes one --dc")
    spec = _spec(values, offsets_m[0] if offsets_m else None)
    settings, config = _settings("stress", spec, values)
    asked = [method for method in methods or (UeMethod.CROPTTA,) if method is not UeMethod.NONE]
    if len(asked) != 1:
        raise click.UsageError("--stress takes one method that can reject, say --ue croptta")
    suite = StressSuite(_open(values), settings, config, spec, asked[0], judging, tolerance_m)
    with TemporaryDirectory() as scratch:
        flights = [Path(name) for name in inputs]
        if not flights:
            flights = render_flights(Path(scratch), spec.samples or _RENDERED_FRAMES, spec.seed + 1)
            suite = replace(suite, spec=replace(spec, camera=_rendered_camera()))
        rows = []
        for row in suite.rows(flights):
            rejected = f"{row.rejected_fraction:.0%} of {row.frames} rejected"
            say(f"{row.flight}: {row.category} {row.severity:g}: {rejected}")
            rows.append(row)
    print_table(folder.write_stress(rows))


def _rendered_camera() -> "CameraSpec":
    from uasthn_cli.ingest.cameras import CameraSpec
    from uasthn_cli.synth.flight_config import FlightConfig

    return CameraSpec(hfov_deg=FlightConfig().hfov_deg)


def _open(values: dict[str, Any]) -> "list[Estimator]":
    from uasthn_cli.evaluation.members import open_members
    from uasthn_cli.matching.memory import keep_freed_memory

    keep_freed_memory()
    return open_members(
        values["estimator"],
        values["weights"],
        device=values["device"],
        symmetries=values["symmetries"],
        ensemble=values["ensemble"],
        ue_iterations=values["ue_iterations"],
    )


def _spec(values: dict[str, Any], offset_m: float | None) -> Any:
    from uasthn_cli.datasets.spec import DatasetSpec

    crops: CropTtaConfig = values["crops"]
    return DatasetSpec(
        window_m=values["window_m"],
        thermal_m=values["thermal_m"],
        max_offset_m=offset_m,
        gsd_m=values["gsd_m"],
        samples=values["samples"],
        seed=crops.seed,
        split=values["split"],
        exclude_validation=values["exclude_validation"],
        camera=values["camera"],
    )


def _settings(source: str, spec: Any, values: dict[str, Any]) -> "tuple[Settings, ProtocolConfig]":
    """Return what the predictions' header says, and how views are cropped and matched."""
    from uasthn_cli.evaluation.members import describe_file, describe_weights
    from uasthn_cli.evaluation.predictions import Settings
    from uasthn_cli.evaluation.protocol import ProtocolConfig
    from uasthn_cli.matching.registry import code_of, spec_of

    crops: CropTtaConfig = values["crops"]
    asked = spec_of(values["estimator"])
    width_px = values["width_px"] or asked.working_width_px
    settings = Settings(
        dataset=source,
        estimator=values["estimator"],
        weights=describe_weights(values["weights"], ensemble=values["ensemble"]),
        views=crops.views,
        sampling=crops.sampling.value,
        offset_fraction=crops.offset_fraction,
        seed=crops.seed,
        max_offset_m=spec.max_offset_m,
        window_m=spec.window_m,
        width_px=width_px,
        device=values["device"],
        thermal_m=spec.thermal_m,
        gsd_m=spec.gsd_m,
        samples=spec.samples,
        split=spec.split,
        camera=str(spec.camera),
        symmetries=values["symmetries"] if asked.has_symmetries else None,
        ue_iterations=values["ue_iterations"],
        tgm=None if values["tgm"] is None else describe_file(values["tgm"]),
        version=code_of(values["estimator"]),
    )
    return settings, ProtocolConfig(crops, width_px)
