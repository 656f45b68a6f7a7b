"""One training run of a displacement network, from pairs to weights."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from uasthn_cli import __version__
from uasthn_cli.datasets.samples import MatchDataset
from uasthn_cli.errors import TrainingDataError
from uasthn_cli.matching.displacement.checkpoints import serialise_model
from uasthn_cli.outputs import atomic
from uasthn_cli.training.displacement.batches import fingerprint, width_ratio
from uasthn_cli.training.displacement.card import DisplacementStory, displacement_card
from uasthn_cli.training.displacement.config import DisplacementConfig
from uasthn_cli.training.displacement.loop import train_displacement_steps, validate_displacement
from uasthn_cli.training.displacement.network import (
    build_network,
    read_initial_model,
    trained_model,
)
from uasthn_cli.training.displacement.trainee import open_displacement_trainee
from uasthn_cli.training.export import OutputPaths
from uasthn_cli.training.loop import Progress, Validation
from uasthn_cli.training.run import ResumableRun
from uasthn_cli.training.tgm.thermal_generator import GeneratorFile


@dataclass(frozen=True, slots=True)
class DisplacementJob:
    """What to learn from, how, and where the weights go.

    ``config.width_ratio`` is replaced by that of the first sample, or of the initial weights.
    ``source``, ``licence_note`` and ``command_line`` go into the model card as they are;
    ``validation`` holds pairs that are never trained on; ``thermal`` draws the thermal images of
    ``config.tgm_share`` of the others.
    """

    out: Path
    dataset: MatchDataset
    source: str
    config: DisplacementConfig
    validation: MatchDataset | None = None
    validate_every: int = 500
    overwrite: bool = False
    licence_note: str | None = None
    command_line: str | None = None
    initial_weights: Path | None = None
    thermal: GeneratorFile | None = None


class DisplacementRun(ResumableRun):
    """Call :meth:`train`, to its end, and then :meth:`export`."""

    def __init__(self, job: DisplacementJob) -> None:
        """Check the output, look at the pairs, and take up the checkpoint if there is one.

        Raises:
            OutputError: the output exists or cannot be written.
            TrainingDataError: there are no pairs, those to judge by are those to learn from, a
                frozen stage would be random, or the checkpoint is of another run.
            WeightsError: the initial weights cannot be used.
        """
        paths = OutputPaths(job.out)
        paths.prepare(job.overwrite)
        data = fingerprint(job.dataset)
        if job.validation is not None and fingerprint(job.validation) == data:
            raise TrainingDataError(
                f"{job.source}: the pairs to judge by are those to learn from; give others"
            )
        self._initial = None
        ratio = width_ratio(job.dataset)
        if job.initial_weights is not None:
            self._initial = read_initial_model(job.initial_weights, job.config.network)
            ratio = self._initial.model.settings.width_ratio
        elif job.config.first_stage == "frozen":
            raise TrainingDataError(
                "a frozen first stage of random weights finds nothing: give --init, or train both"
            )
        config = replace(job.config, width_ratio=ratio)
        self._job = replace(job, config=config)
        network = build_network(config, self._initial)
        origins = {
            "data": data,
            "initial": "" if self._initial is None else self._initial.sha256,
            "generator": "" if job.thermal is None else job.thermal.sha256,
        }
        trainee = open_displacement_trainee(network, config, paths.checkpoint, origins)
        super().__init__(paths, trainee, job.validate_every)

    def export(self) -> Validation | None:
        """Write weights and model card; return the last validation, None without pairs for it.

        Raises:
            OutputError: a file cannot be written.
        """
        job, config = self._job, self._job.config
        validation = self._validation or self._validate()
        notes = {
            "version": __version__,
            "steps": str(config.steps),
            "seed": str(config.seed),
            "licence_note": job.licence_note or "",
        }
        model = trained_model(self._trainee.model, config, notes)
        story = DisplacementStory(
            config=config,
            source=job.source,
            threads=torch.get_num_threads(),
            changes=self.changes,
            validation=validation,
            licence_note=job.licence_note,
            command_line=job.command_line,
            initial=self._initial,
            thermal=job.thermal,
        )
        card = displacement_card(self.paths.weights.name, model, story).encode("utf-8")
        atomic.write_files([(self.paths.card, card), (self.paths.weights, serialise_model(model))])
        return validation

    def _steps(self, on_step: Callable[[int], None]) -> Iterator[Progress]:
        job, path = self._job, self.paths.checkpoint
        generator = None if job.thermal is None else job.thermal.generator
        return train_displacement_steps(
            self._trainee, job.dataset, job.config, path, on_step, generator
        )

    def _validate(self) -> Validation | None:
        if self._job.validation is None:
            return None
        return validate_displacement(self._trainee.model, self._job.validation, self._job.config)
