"""What an estimator is: all that the rest of the package asks of its name.

A package of someone else's offers its estimator by an entry point of the group :data:`GROUP` whose
name is that of the :class:`EstimatorSpec` it points to.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Final

from uasthn_cli.config import DEFAULT_SYMMETRIES

if TYPE_CHECKING:
    from uasthn_cli.seam import Estimator

GROUP: Final = "uasthn.estimators"


class WeightsUse(StrEnum):
    """Whether an estimator reads a user's files of weights, and whether it can do without."""

    NONE = "none"
    OPTIONAL = "optional"
    REQUIRED = "required"


@dataclass(frozen=True, slots=True)
class Opening:
    """What an estimator is opened with: only what its specification says it understands.

    ``name`` is as the user gave it, with the parameter of a ``NAME:PARAMETER``. ``weights`` are
    files of the user's: several only for one that averages. ``device`` is ``auto``, ``cpu`` or
    ``cuda``. ``second_scale`` opens what looks at the second GSD of
    :attr:`EstimatorSpec.second_scale`.
    """

    name: str
    weights: tuple[Path, ...] = ()
    device: str = "auto"
    symmetries: int = DEFAULT_SYMMETRIES
    ensemble: bool = False
    second_scale: bool = False
    ue_iterations: int | None = None


@dataclass(frozen=True, slots=True)
class EstimatorSpec:
    """One estimator: its name, how it is opened, and what may be asked of it.

    Attributes:
        name: As given to ``--estimator``.
        open: Returns the :class:`uasthn_cli.seam.Estimator`; imports what is heavy when called.
        parameter: What follows the name and a colon, say ``NAME`` of ``vismatch:NAME``.
        working_width_px: Width at which ``evaluate`` shows it thermal images; None: their own.
        second_scale: It looks at a second GSD as well: this times the first.
        weights: Whether it takes files of weights.
        bundled_weights: Those in the box, the first its default; several are an ensemble.
        averages: Several networks are one estimator, whose scores are averaged into one answer;
            else each is a member of an ensemble and answers for itself.
        has_symmetries: It can see both images in several orientations (``--symmetries``).
        has_early_stopping: It takes steps that crops can leave early (``--ue-iterations``).
        scores_shifts: It scores every shift, so that a flight can settle its frames.
        may_have_head: Its network may state its own deviations (Direct Modeling).
        is_trained_here: ``uasthn train`` makes its weights.
        calibration: The file of trust made of its answers with its default weights.
        works_in_processes: Several processes may each ask a copy of it, forked when it is loaded,
            on one core; else a run asks it about one frame at a time, and leaves the cores to its
            own threads.
        package: The package it comes from and that one's code; None: built in. Set when an entry
            point is read.
    """

    name: str
    open: "Callable[[Opening], Estimator]"
    parameter: str | None = None
    working_width_px: int | None = None
    second_scale: float | None = None
    weights: WeightsUse = WeightsUse.NONE
    bundled_weights: tuple[Path, ...] = ()
    averages: bool = False
    has_symmetries: bool = False
    has_early_stopping: bool = False
    scores_shifts: bool = False
    may_have_head: bool = False
    is_trained_here: bool = False
    calibration: Path | None = None
    works_in_processes: bool = False
    package: str | None = None

    @property
    def has_ensemble(self) -> bool:
        """Whether several networks of it are in the box."""
        return len(self.bundled_weights) > 1

    @property
    def written(self) -> str:
        """Return how it is written on a command line."""
        return self.name if self.parameter is None else f"{self.name}:{self.parameter}"
