"""What a training run leaves behind: weights, and a model card that says where they come from."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from uasthn_cli import __version__
from uasthn_cli.errors import OutputError
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.torch_weights import serialise_xcorr
from uasthn_cli.outputs import atomic
from uasthn_cli.training.loop import Validation
from uasthn_cli.training.scenes import ImageSource, RenderedShares
from uasthn_cli.training.trainee import InitialWeights, TrainingConfig

SUFFIX = ".safetensors"


@dataclass(frozen=True, slots=True)
class OutputPaths:
    """The files of a run, named after its weights."""

    weights: Path

    @property
    def card(self) -> Path:
        """The model card."""
        return self.weights.with_suffix(".md")

    @property
    def log(self) -> Path:
        """The CSV log."""
        return self.weights.with_suffix(".log.csv")

    @property
    def checkpoint(self) -> Path:
        """What a killed run goes on from."""
        return self.weights.with_suffix(".checkpoint.pt")

    def prepare(self, overwrite: bool) -> None:
        """Create the folder and check that files may be written; call it before any work.

        Raises:
            OutputError: the name does not fit, files exist already, or none can be written.
        """
        if self.weights.suffix != SUFFIX:
            raise OutputError(f"{self.weights}: give --out a name that ends in {SUFFIX}")
        files = [self.weights, self.card]
        if not self.checkpoint.exists():  # an interrupted run goes on with its log
            files.append(self.log)
        found = [path.name for path in files if path.exists()]
        if found and not overwrite:
            raise OutputError(
                f"{self.weights.parent} already holds {', '.join(found)}: choose another --out,"
                " or add --overwrite"
            )
        self._require_writable()

    def _require_writable(self) -> None:
        folder = self.weights.parent
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot create {folder}: {error.strerror or error}") from error
        for path in (self.weights, self.card, self.log, self.checkpoint):
            if path.is_dir():
                raise OutputError(f"{path} is a folder; choose another --out")
            atomic.remove_leftovers(path)
        probe = folder / ".uasthn-probe"
        atomic.write_bytes(probe, b"")
        probe.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class TrainingStory:
    """What a model card tells: nothing in it depends on when or how fast training ran."""

    config: TrainingConfig
    sources: Sequence[ImageSource]
    rendered: RenderedShares
    threads: int
    changes: Sequence[str]
    validation: Validation
    licence_note: str | None
    command_line: str | None
    initial: InitialWeights | None = None
    teacher: InitialWeights | None = None


def export(paths: OutputPaths, model: XcorrModel, story: TrainingStory) -> None:
    """Write weights and model card, both or neither; the same run gives the same bytes.

    Raises:
        OutputError: a file cannot be written.
    """
    notes = {
        "version": __version__,
        "steps": str(story.config.steps),
        "seed": str(story.config.seed),
        "licence_note": story.licence_note or "",
    }
    card = "\n".join(_card(paths.weights.name, model, story)) + "\n"
    weights = serialise_xcorr(model, notes)
    atomic.write_files([(paths.card, card.encode("utf-8")), (paths.weights, weights)])


def _card(name: str, model: XcorrModel, story: TrainingStory) -> Iterator[str]:
    yield from (
        f"# {name}",
        "",
        "Weights of the `xcorr` estimator of uasthn: two encoders that turn a satellite map and",
        "a thermal frame into features that look alike.",
        "",
        "## Training data",
        "",
    )
    yield from _data(story)
    yield from ("", "## Training", "", "| setting | value |", "|---|---|")
    yield from (f"| {setting} | {value} |" for setting, value in _settings(story))
    yield from (f"\nChanged on the way: {change}." for change in story.changes)
    if story.command_line is not None:
        yield from ("", "```sh", story.command_line, "```")
    yield from ("", "## Validation", "")
    yield from _validation(story)
    yield from ("", "## Network", "")
    yield from _network(model)


def _data(story: TrainingStory) -> Iterator[str]:
    if story.sources:
        yield from (
            f"{story.rendered.imagery:.0%} of the windows show overhead imagery through random"
            " pseudo-thermal renderings:",
            "",
            "| images | files | weight |",
            "|---|---|---|",
        )
        for source in story.sources:
            yield f"| `{source.pattern}` | {source.images} | {source.weight:g} |"
        yield ""
    if story.rendered.sand > 0:
        yield (
            f"{story.rendered.sand:.0%} of the windows show rendered sand: dunes, tracks, plots,"
            " scrub."
        )
    if story.rendered.landscapes > 0:
        yield f"{story.rendered.landscapes:.0%} of the windows show rendered landscapes."
    yield "No thermal image was used."
    yield from ("", f"Licence note: {story.licence_note or 'none was given.'}")


def _settings(story: TrainingStory) -> Iterator[tuple[str, object]]:
    config = story.config
    yield "uasthn", __version__
    yield "started from", _start(story.initial)
    if story.teacher is not None:
        yield "learned the features of", f"`{story.teacher.name}`, SHA-256 {story.teacher.sha256}"
    yield "steps", config.steps
    yield "batch", f"{config.samples.windows} windows × {config.samples.canvases} thermal views"
    yield "seed", config.seed
    yield "learning rate", f"{config.learning_rate:g}"
    yield "precision", "bfloat16" if config.bfloat16 else "float32"
    yield "device", config.device
    if config.device == "cpu":
        yield "threads", story.threads
    yield "engine without", ", ".join(config.samples.engine.missing) or "nothing: all parts are on"


def _start(initial: InitialWeights | None) -> str:
    if initial is None:
        return "random weights"
    return f"`{initial.name}`, SHA-256 {initial.sha256}"


def _validation(story: TrainingStory) -> Iterator[str]:
    yield (
        "On batches that training never drew, but of the same scenes: they say that training"
        " worked, not how well real frames are found."
    )
    yield from ("", "| figure | value |", "|---|---|")
    yield f"| median error of the search | {story.validation.median_error_px:.2f} px |"
    yield f"| searches within 4 px | {story.validation.within_4_px:.1%} |"


def _network(model: XcorrModel) -> Iterator[str]:
    architecture = model.architecture
    widths = ", ".join(map(str, architecture.widths))
    parameters = sum(parameter.numel() for parameter in model.parameters())
    yield from ("| part | size |", "|---|---|")
    yield f"| feature channels | {architecture.feature_channels} |"
    yield f"| widths of an encoder's four levels | {widths} |"
    yield f"| parameters | {parameters:,} |"
