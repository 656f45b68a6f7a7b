"""The model card of a trained displacement network."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from uasthn_cli import __version__
from uasthn_cli.config import PAPER_THERMAL_PX
from uasthn_cli.matching.displacement.model import DisplacementModel
from uasthn_cli.training.displacement.config import DisplacementConfig
from uasthn_cli.training.displacement.network import InitialModel
from uasthn_cli.training.loop import Validation
from uasthn_cli.training.tgm.thermal_generator import GeneratorFile

_WHAT: Final = {
    "dhn": "one network that regresses the corners once",
    "ihn": "one network that regresses the corners step by step",
    "sthn": "a network that regresses the corners step by step, and one that looks again at where"
    " the first one found them",
}


@dataclass(frozen=True, slots=True)
class DisplacementStory:
    """What a model card tells: nothing in it depends on when or how fast training ran."""

    config: DisplacementConfig
    source: str
    threads: int
    changes: Sequence[str]
    validation: Validation | None
    licence_note: str | None
    command_line: str | None
    initial: InitialModel | None
    thermal: GeneratorFile | None = None


def displacement_card(name: str, model: DisplacementModel, story: DisplacementStory) -> str:
    """Return the model card, in Markdown."""
    return "\n".join(_lines(name, model, story)) + "\n"


def _lines(name: str, model: DisplacementModel, story: DisplacementStory) -> Iterator[str]:
    yield from (
        f"# {name}",
        "",
        f"Weights of the `{model.name}` estimator of uasthn: {_WHAT[model.name]}.",
        "",
        "## Training data",
        "",
        f"Pairs of `{story.source}`.",
        *_drawn(story),
        "",
        f"Licence note: {story.licence_note or 'none was given.'}",
        "",
        "## Training",
        "",
        "| setting | value |",
        "|---|---|",
    )
    yield from (f"| {setting} | {value} |" for setting, value in _settings(story))
    yield from (f"\nChanged on the way: {change}." for change in story.changes)
    if story.command_line is not None:
        yield from ("", "```sh", story.command_line, "```")
    yield from ("", "## Validation", "")
    yield from _validation(story.validation)
    parameters = sum(value.numel() for value in model.tensors().values())
    yield from ("", "## Network", "", f"{parameters:,} parameters. {_width_note(story.config)}")


def _drawn(story: DisplacementStory) -> Iterator[str]:
    if story.thermal is not None:
        yield (
            f"The thermal images of {story.config.tgm_share:.0%} were drawn from the satellite"
            f" images by `{story.thermal.name}`, SHA-256 {story.thermal.sha256}."
        )


def _settings(story: DisplacementStory) -> Iterator[tuple[str, object]]:
    config = story.config
    yield "uasthn", __version__
    yield "started from", _start(story.initial)
    yield "steps", config.steps
    yield "batch", f"{config.batch} pairs"
    yield "uncertainty", _uncertainty(config)
    if config.network != "dhn":
        yield "iterations", config.iterations
    if config.network == "sthn":
        yield "iterations of the second stage", config.fine_iterations
        yield "first stage", config.first_stage
        yield "box augmentation", f"{config.box_augmentation_px:g} of 1536 px"
    yield "seed", config.seed
    yield "learning rate", f"{config.learning_rate:g}, falling linearly"
    yield "precision", "bfloat16" if config.bfloat16 else "float32"
    yield "device", config.device
    if config.device == "cpu":
        yield "threads", story.threads


def _start(initial: InitialModel | None) -> str:
    if initial is None:
        return "random weights"
    return f"`{initial.name}`, SHA-256 of its tensors {initial.sha256}"


def _uncertainty(config: DisplacementConfig) -> str:
    if config.direct_modeling:
        return "Direct Modeling"
    if config.views == 1:
        return "none: whole images only"
    offset_px = config.crop_offset_fraction * PAPER_THERMAL_PX
    return (
        f"CropTTA loss from step {config.plain_steps} on, {config.views} views, offset"
        f" {offset_px:g} of {PAPER_THERMAL_PX} px"
    )


def _validation(validation: Validation | None) -> Iterator[str]:
    if validation is None:
        yield "None: no other pairs were given to judge by."
        return
    yield "On pairs that training never drew; errors are MACE in pixels of 256."
    yield from ("", "| figure | value |", "|---|---|")
    yield f"| median error | {validation.median_error_px:.2f} px |"
    yield f"| within 4 px | {validation.within_4_px:.1%} |"


def _width_note(config: DisplacementConfig) -> str:
    return (
        f"Satellite images were {config.width_ratio:.4g} times as wide as thermal ones, the only"
        " ratio it knows."
    )
