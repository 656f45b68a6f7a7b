"""``uasthn train --network dhn|ihn|sthn``: pairs in, network weights and their model card out."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from uasthn_cli.commands.console import say
from uasthn_cli.commands.displacement_options import (
    DISPLACEMENT_ONLY,
    XCORR_ONLY,
    AskedDisplacement,
)
from uasthn_cli.commands.options import given_options, if_given
from uasthn_cli.commands.tgm_drawing import (
    drawn_if_rendered,
    open_for_training,
    usual_share,
)
from uasthn_cli.commands.training_progress import as_typed, report_line, train_to_end, validated

if TYPE_CHECKING:
    from uasthn_cli.datasets.samples import MatchDataset
    from uasthn_cli.ingest.cameras import CameraSpec
    from uasthn_cli.training.displacement.config import DisplacementConfig

_ENDLESS: Final = 2**31 - 1
"""Rendered sources make as many samples as are asked for; others have what they have."""

_BOSON_VALIDATION: Final = "val_queries.h5"


def refuse_displacement_options(context: click.Context) -> None:
    """Refuse options that ``xcorr`` would ignore.

    Raises:
        click.UsageError: one was given.
    """
    for name in given_options(context, DISPLACEMENT_ONLY):
        if name == "DATASET":
            raise click.UsageError(
                "xcorr learns from --images; a DATASET is for --network dhn, ihn or sthn"
            )
        raise click.UsageError(f"{name} is for --network dhn, ihn or sthn, not for xcorr")


def train_displacement(
    context: click.Context, asked: AskedDisplacement, camera: "CameraSpec"
) -> None:
    """Train as the options of ``uasthn train`` say.

    Raises:
        click.UsageError: options that make no sense together.
        UasthnError: the data, the weights or the output cannot be used.
    """
    from uasthn_cli.training.displacement import run

    values = context.params
    config = _config(context, asked)
    dataset, validation = _open_pairs(asked, camera)
    thermal = None
    if asked.tgm is not None:
        thermal = open_for_training(asked.tgm, config)
        config = replace(config, tgm_share=asked.tgm_share or usual_share(dataset))
        validation = drawn_if_rendered(validation, thermal.generator)
    if validation is None:
        say("no validation: give --validate pairs that are never trained on")
    job = run.DisplacementJob(
        out=values["out"],
        dataset=dataset,
        source=str(asked.dataset),
        config=config,
        validation=validation,
        validate_every=values["validate_every"],
        overwrite=values["overwrite"],
        licence_note=values["licence_note"],
        command_line=shlex.join(as_typed(context)),
        initial_weights=values["init"],
        thermal=thermal,
    )
    training = run.DisplacementRun(job)
    train_to_end(training, config.steps, report_line)
    card = training.paths.card
    say(f"{validated(training.export())}; weights are in {job.out}, their model card in {card}")


def _config(context: click.Context, asked: AskedDisplacement) -> "DisplacementConfig":
    """Return how to train; refuse what is for ``xcorr`` or makes no sense."""
    from uasthn_cli.config import Precision
    from uasthn_cli.matching.device import choose_device
    from uasthn_cli.training.precision import use_bfloat16

    values = context.params
    network = values["network"]
    for name in given_options(context, XCORR_ONLY):
        raise click.UsageError(f"{name} is for --network xcorr, not for {network}")
    if asked.dataset is None:
        raise click.UsageError(f"{network} learns from pairs: give a DATASET")
    if asked.first_stage == "frozen" and values["init"] is None:
        raise click.UsageError("--first-stage frozen needs a trained first stage: give --init")
    if asked.tgm_share is not None and asked.tgm is None:
        raise click.UsageError("--tgm-share says how much --tgm draws: give a generator")
    device = choose_device(values["device"])
    return asked.config(
        network,
        steps=if_given(context, "steps"),
        learning_rate=if_given(context, "learning_rate"),
        seed=values["seed"],
        device=device,
        bfloat16=use_bfloat16(Precision(values["precision"]), device),
        workers=values["workers"],
        checkpoint_every=values["checkpoint_every"],
    )


def _open_pairs(
    asked: AskedDisplacement, camera: "CameraSpec"
) -> "tuple[MatchDataset, MatchDataset | None]":
    """Return what to learn from, and what to judge by."""
    from uasthn_cli.datasets.opening import open_dataset
    from uasthn_cli.datasets.rendered import RenderedDataset
    from uasthn_cli.datasets.spec import DatasetSpec

    source = str(asked.dataset)
    spec = DatasetSpec(
        window_m=asked.window_m,
        thermal_m=asked.thermal_m,
        max_offset_m=asked.max_offset_m,
        gsd_m=asked.gsd_m,
        samples=_ENDLESS,
        split="train",
        exclude_validation=asked.exclude_validation,
        camera=camera,
        yaw_error_deg=asked.yaw_error_deg,
        scale_error=asked.scale_error,
    )
    dataset = open_dataset(source, spec)
    held_out = replace(spec, samples=None, split="val", seed=spec.seed + 1)
    is_held_out = (
        isinstance(dataset, RenderedDataset) or (Path(source) / _BOSON_VALIDATION).exists()
    )
    judge = asked.validation or (source if is_held_out else None)
    return dataset, None if judge is None else open_dataset(judge, held_out)
