"""The paper's ablations of its uncertainty, each in a panel of its own (Fig. 3), on one data set.

    python benchmarks/uncertainty_ablation.py DATASET --ensemble --dc 512 --out out/ablation

Accepted fraction against the mean MACE of what is accepted, over all thresholds, for: number of
crops in training (`--trained CROPS=WEIGHTS`), sampling, crop offset, number of views, aggregation,
early stopping (`dhn` has no steps, `xcorr` and `ncc` neither), and merge. Predictions are made once
for each setting and kept in the output folder; a run that was killed goes on from them.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import click
from tables import machine_line, markdown_table, number, use_threads

from uasthn_cli.config import Aggregation, CropTtaConfig, GeotagConfig, Merge, Sampling, UeMethod
from uasthn_cli.datasets.opening import open_dataset
from uasthn_cli.datasets.spec import DatasetSpec
from uasthn_cli.evaluation.judging import Judged, JudgingConfig, judge
from uasthn_cli.evaluation.members import describe_weights, open_members
from uasthn_cli.evaluation.metrics import acceptance_curve, score
from uasthn_cli.evaluation.predictions import Predictions, Settings
from uasthn_cli.evaluation.protocol import ProtocolConfig
from uasthn_cli.evaluation.run import predict_to_file
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.matching.memory import keep_freed_memory
from uasthn_cli.matching.registry import spec_of
from uasthn_cli.outputs.atomic import write_bytes, write_text
from uasthn_cli.report.drawing import Axes, Figure, encode, styled

THREADS: Final = 1
COLUMNS: Final = (
    "ablation",
    "setting",
    "accepted at 10 m",
    "their MACE m",
    "all: MACE m",
    "AUC",
    "AURC",
)
_OFFSETS_PX: Final = (8.0, 16.0, 32.0, 64.0, 128.0)
_VIEWS: Final = (2, 3, 5, 9)
_STOPS: Final = (1, 2, 3, 4, 6)
_PAPER_WIDTH_PX: Final = 512
_LEAST_SHOWN: Final = 0.1
"""Below this accepted fraction single samples make the mean, and the curve is noise."""

_COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#000000")
_LINES: Final = ("-", "--", "-.", ":", (0, (6, 2, 1, 2, 1, 2)), (0, (1, 1)))


@dataclass(frozen=True, slots=True)
class Arm:
    """One curve: how predictions are made, and how they are judged."""

    ablation: str
    setting: str
    crops: CropTtaConfig = field(default_factory=CropTtaConfig)
    weights: tuple[Path, ...] = ()
    ue_iterations: int | None = None
    method: UeMethod = UeMethod.CROPTTA
    judging: JudgingConfig = field(default_factory=JudgingConfig)


@dataclass(frozen=True, slots=True)
class Subject:
    """Who is examined, on what."""

    source: str
    spec: DatasetSpec
    estimator: str
    ensemble: bool
    symmetries: int
    out: Path

    def predictions(self, arm: Arm) -> Predictions:
        """Return what the estimator says with an arm's crops and steps; made once."""
        settings = self._settings(arm)
        name = f"v{arm.crops.views}-{arm.crops.sampling}-o{settings.offset_fraction:g}"
        name += f"-k{arm.ue_iterations or 'all'}-{'+'.join(settings.weights) or 'box'}"
        members = open_members(
            self.estimator,
            arm.weights,
            device="cpu",
            symmetries=self.symmetries,
            ensemble=self._asks_ensemble(arm),
            ue_iterations=arm.ue_iterations,
        )
        return predict_to_file(
            self.out / f"{name.replace('@', '-')}.npz",
            open_dataset(self.source, self.spec),
            members,
            settings,
            ProtocolConfig(arm.crops, settings.width_px),
        )

    def _asks_ensemble(self, arm: Arm) -> bool:
        return self.ensemble and arm.method is not UeMethod.CROPTTA

    def _settings(self, arm: Arm) -> Settings:
        return Settings(
            dataset=self.source,
            estimator=self.estimator,
            weights=describe_weights(arm.weights, ensemble=self._asks_ensemble(arm)),
            views=arm.crops.views,
            sampling=arm.crops.sampling.value,
            offset_fraction=arm.crops.offset_fraction,
            seed=arm.crops.seed,
            max_offset_m=self.spec.max_offset_m,
            window_m=self.spec.window_m,
            width_px=spec_of(self.estimator).working_width_px,
            device="cpu",
            thermal_m=self.spec.thermal_m,
            gsd_m=self.spec.gsd_m,
            samples=self.spec.samples,
            split=self.spec.split,
            camera=str(self.spec.camera),
            symmetries=self.symmetries if spec_of(self.estimator).has_symmetries else None,
            ue_iterations=arm.ue_iterations,
        )


def arms_of(
    estimator: str, weights: tuple[Path, ...], ensemble: bool, trained: dict[str, Path]
) -> Iterator[Arm]:
    """Yield every curve; all that an ablation does not vary is the paper's choice."""
    base, alone = CropTtaConfig(), weights[:1]
    for label, path in trained.items():
        yield Arm("crops in training", label, base, (path,))
    yield from _crop_arms(base, alone)
    for aggregation in Aggregation:
        judging = JudgingConfig(aggregation=aggregation)
        yield Arm("aggregation", f"crops, {aggregation}", base, alone, judging=judging)
    if spec_of(estimator).has_early_stopping:
        for steps in _STOPS:
            yield Arm("early stopping", f"after {steps}", base, alone, steps)
    if ensemble or len(weights) > 1:
        yield from _ensemble_arms(base, weights)


def _crop_arms(base: CropTtaConfig, weights: tuple[Path, ...]) -> Iterator[Arm]:
    """Yield what varies how crops are drawn."""
    for sampling in Sampling:
        yield Arm("sampling", sampling, replace(base, sampling=sampling), weights)
    for offset_px in _OFFSETS_PX:
        crops = replace(base, offset_fraction=offset_px / _PAPER_WIDTH_PX)
        yield Arm("crop offset", f"{offset_px:g} of 512 px", crops, weights)
    for views in _VIEWS:
        yield Arm("number of views", str(views), replace(base, views=views), weights)


def _ensemble_arms(base: CropTtaConfig, weights: tuple[Path, ...]) -> Iterator[Arm]:
    """Yield what needs several networks."""
    for aggregation in Aggregation:
        judging = JudgingConfig(aggregation=aggregation)
        name = f"ensemble, {aggregation}"
        yield Arm("aggregation", name, base, weights, None, UeMethod.DE, judging)
    for merge in Merge:
        judging = JudgingConfig(merge=merge)
        name = f"croptta+de, {merge}"
        yield Arm("merge", name, base, weights, None, UeMethod.CROPTTA_DE, judging)
    yield Arm("merge", "de alone", base, weights, None, UeMethod.DE)


def selected(arms: Sequence[Arm], only: Sequence[str]) -> list[Arm]:
    """Return the arms of these ablations, all if none is named.

    Raises:
        click.UsageError: there is no such ablation here.
    """
    known = {arm.ablation for arm in arms}
    if not known.issuperset(only):
        raise click.UsageError(f"--only is one or more of {', '.join(sorted(known))}")
    return [arm for arm in arms if not only or arm.ablation in only]


def row_of(arm: Arm, judged: Judged) -> list[str]:
    """Return a line of the table."""
    scores = score(judged)
    return [
        arm.ablation,
        arm.setting,
        number(scores.accepted_fraction, 2),
        number(scores.mace_m, 1),
        number(scores.mace_all_m, 1),
        number(scores.auc, 3),
        number(scores.aurc, 3),
    ]


def draw(curves: Sequence[tuple[Arm, Judged]], title: str, file_format: str) -> bytes:
    """Return a figure with a panel for each ablation."""
    ablations = list(dict.fromkeys(arm.ablation for arm, _ in curves))
    columns = min(3, len(ablations))
    rows = math.ceil(len(ablations) / columns)
    with styled():
        figure = Figure(figsize=(4.0 * columns, 3.6 * rows), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False).flatten()
        for axes, ablation in zip(panels, ablations, strict=False):
            _panel(axes, [pair for pair in curves if pair[0].ablation == ablation], ablation)
        for axes in panels[len(ablations) :]:
            axes.set_axis_off()
        figure.suptitle(title, parse_math=False)
        figure.supxlabel("mean MACE of accepted samples [m]")
        figure.supylabel("accepted fraction")
        content = encode(figure, file_format)
        assert content is not None
        return content


def _panel(axes: Axes, curves: Sequence[tuple[Arm, Judged]], ablation: str) -> None:
    for index, (arm, judged) in enumerate(curves):
        points = acceptance_curve(judged)
        shown = points.accepted_fraction >= _LEAST_SHOWN
        style: dict[str, Any] = {"color": _COLOURS[index % 6], "linestyle": _LINES[index % 6]}
        mace_m, accepted = points.mace_m[shown], points.accepted_fraction[shown]
        axes.plot(mace_m, accepted, label=arm.setting, **style)
        if judged.accepted.any():
            at = judged.mace_m[judged.accepted].mean(), judged.accepted.mean()
            axes.plot(*at, "o", color=style["color"], markersize=6, clip_on=False, zorder=5)
    axes.set_title(ablation)
    axes.set_xlim(left=0.0)
    axes.set_ylim(0.0, 1.0)
    axes.legend(loc="best", fontsize=8.5, frameon=True, framealpha=0.85, edgecolor="none")


def _trained(_: click.Context, __: click.Parameter, values: tuple[str, ...]) -> dict[str, Path]:
    pairs = [value.partition("=") for value in values]
    for crops, equals, path in pairs:
        if not equals or not Path(path).is_file():
            raise click.BadParameter(
                f"{crops}{equals}{path}: not CROPS=WEIGHTS of an existing file"
            )
    return {crops: Path(path) for crops, _, path in pairs}


@click.command()
@click.argument("dataset")
@click.option("--estimator", default=GeotagConfig().estimator, show_default=True)
@click.option("--weights", type=click.Path(exists=True, path_type=Path), multiple=True)
@click.option("--ensemble", is_flag=True, help="The three networks in the box.")
@click.option("--trained", multiple=True, callback=_trained, metavar="CROPS=WEIGHTS")
@click.option("--only", multiple=True, metavar="ABLATION", help="Of all; can be repeated.")
@click.option("--dc", "offset_m", type=float, default=512.0, show_default=True)
@click.option("--samples", type=int, default=60, show_default=True)
@click.option("--hfov", "hfov_deg", type=float, help="Of a flight's camera.")
@click.option("--symmetries", type=click.IntRange(1, 8), default=1, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), required=True)
def main(
    dataset: str,
    estimator: str,
    weights: tuple[Path, ...],
    ensemble: bool,
    trained: dict[str, Path],
    only: tuple[str, ...],
    offset_m: float,
    samples: int,
    hfov_deg: float | None,
    symmetries: int,
    out: Path,
) -> None:
    """Draw the paper's ablations for an estimator on a data set."""
    use_threads(THREADS)
    keep_freed_memory()
    camera = CameraSpec(hfov_deg=hfov_deg) if hfov_deg else CameraSpec()
    spec = DatasetSpec(max_offset_m=offset_m, samples=samples, camera=camera)
    out.mkdir(parents=True, exist_ok=True)
    subject = Subject(dataset, spec, estimator, ensemble, symmetries, out)
    curves = []
    for arm in selected(list(arms_of(estimator, weights, ensemble, trained)), only):
        predictions = subject.predictions(arm)
        curves.append((arm, judge(predictions, arm.method, arm.judging)))
        click.echo(f"{arm.ablation}: {arm.setting}", err=True)
    table = markdown_table(COLUMNS, [row_of(arm, judged) for arm, judged in curves])
    write_text(out / "ablation.md", table + "\n")
    title = f"{estimator}, {len(curves[0][1].mace_m)} samples, D_C {offset_m:g} m"
    for file_format in ("png", "svg"):
        write_bytes(out / f"ablation.{file_format}", draw(curves, title, file_format))
    click.echo(table)
    click.echo(machine_line(THREADS))


if __name__ == "__main__":
    main()
