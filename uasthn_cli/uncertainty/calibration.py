"""The file of trust that ``uasthn calibrate`` writes and ``uasthn geotag --calibration`` reads."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from uasthn_cli.errors import CalibrationError
from uasthn_cli.uncertainty.risk_model import SIGNALS, RiskModel, SignalTerm, Transform

FORMAT: Final = "uasthn-calibration-1"
_MADE_OF: Final = "made_of"
_UNIT: Final = "unit"


@dataclass(frozen=True, slots=True)
class Judgement:
    """How one kind of answer is judged: accept where the risk is at most ``max_risk``.

    ``ce90_scale`` makes a predicted 90 % radius cover 90 % of the errors of accepted answers. The
    rest tells where both come from: the model was fitted to ``fit_frames``; of ``frames`` others
    ``accepted`` would have been accepted, ``errors`` of these wrongly; ``ce90_frames`` gave the
    scale (0: it was not learned and is 1). ``max_risk`` 0 accepts nothing: none could be certified.
    """

    model: RiskModel
    max_risk: float
    ce90_scale: float
    fit_frames: int
    frames: int
    accepted: int
    errors: int
    ce90_frames: int

    @property
    def accepted_fraction(self) -> float:
        """Return the share of the certification's frames that would have been accepted."""
        return self.accepted / self.frames


@dataclass(frozen=True, slots=True)
class AnswerKind:
    """Whose answers were calibrated: the estimator, and the method that told their uncertainty."""

    estimator: str
    ue: str

    def __str__(self) -> str:
        """Return the options of ``uasthn geotag`` that give such answers."""
        return f"--estimator {self.estimator} --ue {self.ue}"


class Unit(StrEnum):
    """What a promise counts as one independent draw."""

    FRAME = "frame"
    FLIGHT = "flight"


@dataclass(frozen=True, slots=True)
class Calibration:
    """A promise, and how single-frame and flight-fused answers are judged to keep it.

    With probability ``confidence_level`` over the frames it was certified on, at most a share of
    ``target_risk`` of accepted frames lies farther than ``tolerance_m`` from the truth. ``fused``
    is None where no fused answers were seen; ``note`` says what the frames were. It speaks of
    answers like those it was ``made_of``: None where it does not say, as of earlier versions.
    ``unit`` is what the promise is about: of earlier versions always frames.
    """

    tolerance_m: float
    target_risk: float
    confidence_level: float
    single: Judgement
    fused: Judgement | None
    note: str
    made_of: AnswerKind | None = None
    unit: Unit = Unit.FRAME

    @property
    def promise(self) -> str:
        """Return in one line what is promised about what."""
        share = f"at most {self.target_risk:g} of accepted frames beyond {self.tolerance_m:g} m"
        sure = f"confidence {self.confidence_level:g}"
        if self.unit is Unit.FLIGHT:
            return f"{share}, mean over flights like those it was made of, {sure}"
        return f"{share}, {sure}, of frames taken as independent: a single flight may break it"

    def to_json(self) -> dict[str, Any]:
        """Return the calibration in the types of JSON."""
        document: dict[str, Any] = json.loads(json.dumps({"format": FORMAT, **asdict(self)}))
        return document

    @classmethod
    def from_json(cls, document: Any, where: str = "calibration") -> "Calibration":
        """Read what :meth:`to_json` returned; ``where`` begins every message.

        Raises:
            CalibrationError: another format, a key too many or too few, a value out of range.
        """
        if not isinstance(document, Mapping) or document.get("format") != FORMAT:
            raise CalibrationError(
                f"{where}: not a calibration of format {FORMAT}: make one with `uasthn calibrate`"
            )
        fields = {key: document[key] for key in document if key != "format"}
        node = _Node({_MADE_OF: None, _UNIT: Unit.FRAME} | fields, where)
        node.require(cls)
        return cls(
            tolerance_m=node.number("tolerance_m", above=0.0),
            target_risk=node.number("target_risk", above=0.0, below=1.0),
            confidence_level=node.number("confidence_level", above=0.0, below=1.0),
            single=_judgement(node.child("single")),
            fused=None if node.value["fused"] is None else _judgement(node.child("fused")),
            note=node.text("note"),
            made_of=None if node.value[_MADE_OF] is None else _kind(node.child(_MADE_OF)),
            unit=Unit(node.text(_UNIT, tuple(Unit))),
        )


def load_calibration(path: Path) -> Calibration:
    """Read a calibration file.

    Raises:
        CalibrationError: it is missing, no JSON, or no calibration.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise CalibrationError(f"{path}: not JSON: {error}") from error
    return Calibration.from_json(document, str(path))


@dataclass(frozen=True, slots=True)
class _Node:
    """An object of the document and its place in it, for messages."""

    value: Mapping[str, Any]
    where: str

    def require(self, kind: type) -> None:
        """Check that the keys are the fields of a dataclass, no more and no fewer."""
        names = set(kind.__dataclass_fields__)  # type: ignore[attr-defined]
        for problem, keys in (
            ("is missing", names - set(self.value)),
            ("is not known", set(self.value) - names),
        ):
            if keys:
                raise CalibrationError(f"{self.where}: {', '.join(sorted(keys))} {problem}")

    def child(self, key: str) -> "_Node":
        return _as_node(self.value[key], f"{self.where}: {key}")

    def children(self, key: str) -> list["_Node"]:
        values = self.value[key]
        if not isinstance(values, list) or not values:
            raise self._unlike(key, "a list that is not empty")
        return [_as_node(value, f"{self.where}: {key}[{k}]") for k, value in enumerate(values)]

    def number(self, key: str, above: float = -math.inf, below: float = math.inf) -> float:
        """Return a finite number strictly between two bounds."""
        value = self.value[key]
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value) or not above < value < below:
            raise self._unlike(key, f"a number between {above:g} and {below:g}")
        return float(value)

    def count(self, key: str) -> int:
        value = self.value[key]
        if not isinstance(value, int) or isinstance(value, bool) or value < 0:
            raise self._unlike(key, "a whole number of at least 0")
        return value

    def text(self, key: str, choices: tuple[str, ...] = ()) -> str:
        value = self.value[key]
        if not isinstance(value, str) or (choices and value not in choices):
            raise self._unlike(key, " or ".join(choices) if choices else "text")
        return value

    def _unlike(self, key: str, expected: str) -> CalibrationError:
        return CalibrationError(f"{self.where}: {key} is {self.value[key]!r}, expected {expected}")


def _as_node(value: Any, where: str) -> _Node:
    if not isinstance(value, Mapping):
        raise CalibrationError(f"{where} is {value!r}, expected an object")
    return _Node(value, where)


def _kind(node: _Node) -> AnswerKind:
    node.require(AnswerKind)
    return AnswerKind(node.text("estimator"), node.text("ue"))


def _judgement(node: _Node) -> Judgement:
    node.require(Judgement)
    model = node.child("model")
    model.require(RiskModel)
    judgement = Judgement(
        model=RiskModel(tuple(map(_term, model.children("terms"))), model.number("bias")),
        max_risk=node.number("max_risk", above=-math.ulp(0.0), below=1.0),
        ce90_scale=node.number("ce90_scale", above=0.0),
        fit_frames=node.count("fit_frames"),
        frames=node.count("frames"),
        accepted=node.count("accepted"),
        errors=node.count("errors"),
        ce90_frames=node.count("ce90_frames"),
    )
    if not judgement.errors <= judgement.accepted <= judgement.frames or not judgement.frames:
        raise CalibrationError(f"{node.where}: frames, accepted and errors contradict each other")
    return judgement


def _term(node: _Node) -> SignalTerm:
    node.require(SignalTerm)
    return SignalTerm(
        signal=node.text("signal", tuple(SIGNALS)),
        transform=Transform(node.text("transform", tuple(Transform))),
        mean=node.number("mean"),
        deviation=node.number("deviation", above=0.0),
        weight=node.number("weight"),
    )
