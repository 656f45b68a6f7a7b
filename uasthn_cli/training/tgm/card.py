"""The model card of a thermal generator."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from uasthn_cli import __version__
from uasthn_cli.training.tgm.config import TgmConfig
from uasthn_cli.training.tgm.pairs import PairsSummary
from uasthn_cli.training.tgm.weights import TrainedGenerator


@dataclass(frozen=True, slots=True)
class TgmStory:
    """What a model card tells: nothing in it depends on when or how fast training ran.

    ``validation_l1_grey`` is None where no other pairs were given to judge by.
    """

    config: TgmConfig
    pairs: PairsSummary
    source: str
    threads: int
    changes: Sequence[str]
    validation_l1_grey: float | None
    licence_note: str | None


def tgm_card(name: str, generator: TrainedGenerator, story: TgmStory) -> str:
    """Return the model card, in Markdown."""
    return "\n".join(_lines(name, generator, story)) + "\n"


def _lines(name: str, generator: TrainedGenerator, story: TgmStory) -> Iterator[str]:
    yield from (
        f"# {name}",
        "",
        "A thermal generator (TGM) of uasthn: draws what a thermal camera might see by night of a",
        "place that a satellite saw by day. What it draws is material to train on, no measurement.",
        "",
        "## Training data",
        "",
        f"{story.pairs.pairs} pairs of `{story.source}`, {generator.size_px} px of"
        f" {generator.gsd_m:.3g} m.",
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
    yield from ("", "## Validation", "", _validation(story), "", "## Network", "")
    yield from _network(generator, story)


def _settings(story: TgmStory) -> Iterator[tuple[str, object]]:
    config = story.config
    yield "uasthn", __version__
    yield "loss", f"adversarial + {config.l1_weight:g} × L1 (pix2pix)"
    yield "steps", config.steps
    yield "batch", config.batch
    yield "optimiser", f"Adam {config.learning_rate:g}, betas {config.betas[0]}, {config.betas[1]}"
    yield "schedule", "held for half of the steps, then falling to 0"
    yield "augmentation", f"mirrored, shifted by up to {config.jitter_px} px"
    yield "seed", config.seed
    yield "device", config.device
    if config.device == "cpu":
        yield "threads", story.threads


def _validation(story: TgmStory) -> str:
    if story.validation_l1_grey is None:
        return "No other pairs were given to judge by."
    return (
        "Mean absolute error on pairs that training never drew:"
        f" {story.validation_l1_grey:.1f} of 255 grey levels."
    )


def _network(generator: TrainedGenerator, story: TgmStory) -> Iterator[str]:
    architecture = generator.architecture
    parameters = sum(parameter.numel() for parameter in generator.network.parameters())
    yield from ("| part | size |", "|---|---|")
    yield f"| generator | {architecture.kind} |"
    yield f"| channels next to the image | {architecture.width} |"
    yield f"| parameters | {parameters:,} |"
    yield f"| channels of the discriminator (not kept) | {story.config.discriminator_width} |"
