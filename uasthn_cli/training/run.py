"""One training run from its images to its weights; what was interrupted goes on."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from uasthn_cli.training.export import OutputPaths, TrainingStory, export
from uasthn_cli.training.loop import Progress, Validation, reduced_teacher, train_steps, validate
from uasthn_cli.training.scenes import RenderedShares, load_scenes
from uasthn_cli.training.trainee import (
    Trainee,
    TrainingConfig,
    open_trainee,
    read_initial_weights,
)
from uasthn_cli.training.training_log import TrainingLog


@dataclass(frozen=True, slots=True)
class TrainingJob:
    """What to train on, how, and where the weights go.

    ``images`` are glob patterns with weights; ``licence_note`` and ``command_line`` go into the
    model card as they are. With ``initial_weights`` the network starts from that file and has its
    architecture; with a ``teacher`` it learns that network's features and not the search.
    """

    out: Path
    images: tuple[tuple[str, float], ...]
    rendered: RenderedShares
    config: TrainingConfig
    validate_every: int
    overwrite: bool = False
    licence_note: str | None = None
    command_line: str | None = None
    initial_weights: Path | None = None
    teacher: Path | None = None


@dataclass(frozen=True, slots=True)
class Report:
    """Progress of the encoders and, every so often, their validation."""

    progress: Progress
    validation: Validation | None


class ResumableRun(ABC):
    """Steps, log and validation of any network; what was interrupted goes on."""

    def __init__(self, paths: OutputPaths, trainee: Trainee[Any], validate_every: int) -> None:
        """Go on where the trainee is.

        Raises:
            OutputError: there is another kind of file where the log should be.
        """
        self.paths, self._trainee, self._validate_every = paths, trainee, validate_every
        self._log = TrainingLog(paths.log, trainee.step)
        self.saved_step = trainee.step
        self._validation: Validation | None = None

    @property
    def changes(self) -> list[str]:
        """Settings that were changed on the way, as sentences."""
        return self._trainee.changes

    def train(self, on_step: Callable[[int], None]) -> Iterator[Report]:
        """Train to the last step; yields after every checkpoint.

        Raises:
            TrainingDivergedError: the loss is no longer finite.
            OutputError: a checkpoint cannot be written.
        """
        before, last = self._trainee.step, self._trainee.settings["steps"]
        for progress in self._steps(on_step):
            self.saved_step = progress.step
            self._log.record(progress)
            self._validation = None
            every = self._validate_every
            if progress.step // every > before // every or progress.step == last:
                self._validation = self._validate()
                self._log.record(progress, self._validation)
            yield Report(progress, self._validation)
            before = progress.step

    @abstractmethod
    def _steps(self, on_step: Callable[[int], None]) -> Iterator[Progress]:
        """Train, yielding after every checkpoint."""

    @abstractmethod
    def _validate(self) -> Validation | None:
        """Judge the network as it is; None where there is nothing to judge by."""


class TrainingRun(ResumableRun):
    """Call :meth:`train`, to its end, and then :meth:`export`."""

    def __init__(self, job: TrainingJob) -> None:
        """Check the output, read the images, and take up the checkpoint if there is one.

        Raises:
            OutputError: the output exists or cannot be written.
            TrainingDataError: there is nothing to train on, or the checkpoint is of another run.
            WeightsError: the initial weights cannot be used.
        """
        paths = OutputPaths(job.out)
        paths.prepare(job.overwrite)
        self._initial = None
        if job.initial_weights is not None:
            self._initial = read_initial_weights(job.initial_weights)
            job = replace(
                job, config=replace(job.config, architecture=self._initial.model.architecture)
            )
        self._job = job
        self._teacher = None if job.teacher is None else read_initial_weights(job.teacher)
        self._scenes = load_scenes(job.images, job.rendered)
        data = self._scenes.fingerprint()
        trainee = open_trainee(job.config, paths.checkpoint, data, self._initial, self._teacher)
        super().__init__(paths, trainee, job.validate_every)

    def export(self) -> Validation:
        """Write weights and model card; return the encoders' last validation.

        Raises:
            OutputError: a file cannot be written.
        """
        validation = self._validation or self._validate()
        story = TrainingStory(
            config=self._job.config,
            sources=self._scenes.sources,
            rendered=self._job.rendered,
            threads=torch.get_num_threads(),
            changes=self.changes,
            validation=validation,
            licence_note=self._job.licence_note,
            command_line=self._job.command_line,
            initial=self._initial,
            teacher=self._teacher,
        )
        export(self.paths, self._trainee.model, story)
        return validation

    def _steps(self, on_step: Callable[[int], None]) -> Iterator[Progress]:
        path, config, teacher = self.paths.checkpoint, self._job.config, None
        if self._teacher is not None:
            teacher = reduced_teacher(self._teacher.model, self._scenes, config)
        return train_steps(self._trainee, self._scenes, config, path, on_step, teacher)

    def _validate(self) -> Validation:
        return validate(self._trainee.model, self._scenes, self._job.config)
