"""One run of ``uasthn tgm train`` from pairs to weights; what was interrupted goes on."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import torch

from uasthn_cli import __version__
from uasthn_cli.datasets.samples import MatchDataset
from uasthn_cli.errors import TrainingDataError
from uasthn_cli.outputs import atomic
from uasthn_cli.training.export import OutputPaths
from uasthn_cli.training.tgm.card import TgmStory, tgm_card
from uasthn_cli.training.tgm.config import TgmConfig
from uasthn_cli.training.tgm.loop import TgmProgress, train_tgm_steps, validation_l1_grey
from uasthn_cli.training.tgm.pairs import summarise
from uasthn_cli.training.tgm.trainee import open_tgm_trainee
from uasthn_cli.training.tgm.weights import TrainedGenerator, serialise_generator
from uasthn_cli.training.training_log import StepLog

LOG_COLUMNS: Final = (
    "step",
    "seconds",
    "adversarial_loss",
    "discriminator_loss",
    "l1_grey",
    "validation_l1_grey",
)


@dataclass(frozen=True, slots=True)
class TgmJob:
    """What to learn from, how, and where the weights go.

    ``source`` and ``licence_note`` go into the model card as they are; ``validation`` holds
    pairs that are never trained on.
    """

    out: Path
    dataset: MatchDataset
    source: str
    config: TgmConfig
    validation: MatchDataset | None = None
    overwrite: bool = False
    licence_note: str | None = None


@dataclass(frozen=True, slots=True)
class TgmReport:
    """Progress and, where there are pairs to judge by, the error on them in grey levels."""

    progress: TgmProgress
    validation_l1_grey: float | None


class TgmRun:
    """Call :meth:`train`, to its end, and then :meth:`export`."""

    def __init__(self, job: TgmJob) -> None:
        """Check the output, look at the pairs, and take up the checkpoint if there is one.

        Raises:
            OutputError: the output exists or cannot be written.
            TrainingDataError: there are no pairs, those to judge by are those to learn from, or
                the checkpoint is of another run.
        """
        _require_fitting_size(job.config)
        self.paths = OutputPaths(job.out)
        self.paths.prepare(job.overwrite)
        self._job = job
        self._pairs = summarise(job.dataset, job.config.size_px)
        if job.validation is not None:
            held_out = summarise(job.validation, job.config.size_px)
            if held_out.fingerprint == self._pairs.fingerprint:
                raise TrainingDataError(
                    f"{job.source}: the pairs to judge by are those to learn from; give others"
                )
        self._trainee = open_tgm_trainee(job.config, self.paths.checkpoint, self._pairs.fingerprint)
        self._log = StepLog(self.paths.log, self._trainee.step, LOG_COLUMNS)
        self.saved_step = self._trainee.step

    @property
    def changes(self) -> list[str]:
        """Settings that were changed on the way, as sentences."""
        return self._trainee.changes

    def train(self, on_step: Callable[[int], None]) -> Iterator[TgmReport]:
        """Train to the last step; yields after every checkpoint.

        Raises:
            TrainingDivergedError: a loss is no longer finite.
            OutputError: a checkpoint or the log cannot be written.
        """
        job = self._job
        steps = train_tgm_steps(
            self._trainee, job.dataset, job.config, self.paths.checkpoint, on_step
        )
        for progress in steps:
            self.saved_step = progress.step
            report = TgmReport(progress, self._validate())
            self._log.write_row(progress.step, progress.seconds, _figures(report))
            yield report

    def export(self) -> None:
        """Write weights and model card, both or neither; the same run gives the same bytes.

        Raises:
            OutputError: a file cannot be written.
        """
        job, config = self._job, self._job.config
        generator = TrainedGenerator(
            self._trainee.generator, config.architecture, config.size_px, self._pairs.gsd_m
        )
        story = TgmStory(
            config=config,
            pairs=self._pairs,
            source=job.source,
            threads=torch.get_num_threads(),
            changes=self.changes,
            validation_l1_grey=self._validate(),
            licence_note=job.licence_note,
        )
        notes = {
            "version": __version__,
            "steps": str(config.steps),
            "seed": str(config.seed),
            "licence_note": job.licence_note or "",
        }
        card = tgm_card(self.paths.weights.name, generator, story).encode("utf-8")
        weights = serialise_generator(generator, notes)
        atomic.write_files([(self.paths.card, card), (self.paths.weights, weights)])

    def _validate(self) -> float | None:
        if self._job.validation is None:
            return None
        return validation_l1_grey(self._trainee, self._job.validation, self._job.config)


def _figures(report: TgmReport) -> list[str]:
    losses, judged = report.progress.losses, report.validation_l1_grey
    return [
        f"{losses.adversarial:.4f}",
        f"{losses.discriminator:.4f}",
        f"{losses.l1_grey:.3f}",
        "" if judged is None else f"{judged:.3f}",
    ]


def _require_fitting_size(config: TgmConfig) -> None:
    """Check what only a caller of the Python API can get wrong."""
    if config.size_px % config.architecture.stride_px:
        raise ValueError(
            f"images of {config.size_px} px are no multiple of {config.architecture.stride_px} px"
        )
