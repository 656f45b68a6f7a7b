"""What estimators said of pairs: one file, from which every table and figure is drawn."""

import io
import json
import zipfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.errors import PredictionsError
from uasthn_cli.outputs.atomic import write_bytes
from uasthn_cli.types import FloatArray
from uasthn_cli.version import code_version

SUFFIX: Final = ".npz"

_FORMAT: Final = 1


@dataclass(frozen=True, slots=True)
class Settings:
    """How predictions were made.

    ``max_offset_m`` is D_C, ``window_m`` W_S and ``thermal_m`` W_T, ``samples`` how many were asked
    for (None: as the data have it), ``width_px`` the width at which the thermal image was matched
    (None: its own), ``ue_iterations`` after how many iterations all views but the first stop (None:
    never), ``tgm`` which generator drew the thermal images (None: none did).
    """

    dataset: str
    estimator: str
    weights: tuple[str, ...]
    views: int
    sampling: str
    offset_fraction: float
    seed: int
    max_offset_m: float | None
    window_m: float | None
    width_px: int | None
    device: str
    thermal_m: float | None = None
    gsd_m: float | None = None
    samples: int | None = None
    split: str | None = None
    camera: str | None = None
    symmetries: int | None = None
    ue_iterations: int | None = None
    tgm: str | None = None
    version: str = field(default_factory=code_version)


@dataclass(frozen=True, slots=True)
class Prediction:
    """One sample, in pixels of its satellite image.

    ``answers_px`` ``(M, V, 4, 2)`` the full frame's corners by member and view, NaN where not
    asked or without an answer; ``modelled_std_px`` ``(4, 2)`` what a network itself says of its
    error (Direct Modeling), NaN where it says nothing. ``seconds`` ``(3,)``: map and full frame;
    map and all views; the further members. NaN where not measured.
    """

    name: str
    gsd_m: float
    satellite_px: int
    true_px: FloatArray
    prior_px: FloatArray
    answers_px: FloatArray
    modelled_std_px: FloatArray
    confidence: float
    seconds: FloatArray


@dataclass(frozen=True, slots=True)
class Predictions:
    """All samples of one run; arrays as in :class:`Prediction` with ``n`` as the first axis."""

    settings: Settings
    name: NDArray[np.str_]
    gsd_m: FloatArray
    satellite_px: FloatArray
    true_px: FloatArray
    prior_px: FloatArray
    answers_px: FloatArray
    modelled_std_px: FloatArray
    confidence: FloatArray
    seconds: FloatArray

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.name)

    @property
    def members(self) -> int:
        """Number of networks."""
        return int(self.answers_px.shape[1])

    @property
    def views(self) -> int:
        """Number of views of the base network."""
        return int(self.answers_px.shape[2])


_ARRAYS: Final = tuple(field.name for field in fields(Prediction))


def gathered(settings: Settings, samples: Sequence[Prediction]) -> Predictions:
    """Return samples, of which there is at least one, as arrays."""
    columns = {key: np.array([getattr(sample, key) for sample in samples]) for key in _ARRAYS}
    return Predictions(settings, **columns)


def scattered(predictions: Predictions) -> list[Prediction]:
    """Return the samples one by one."""
    columns = [getattr(predictions, key) for key in _ARRAYS]
    return [Prediction(str(name), *values) for name, *values in zip(*columns, strict=True)]


def save_predictions(path: Path, predictions: Predictions) -> None:
    """Write a file atomically.

    Raises:
        OutputError: it cannot be written.
    """
    header = {"format": _FORMAT, **asdict(predictions.settings)}
    content = io.BytesIO()
    arrays: dict[str, Any] = {key: getattr(predictions, key) for key in _ARRAYS}
    np.savez_compressed(content, header=np.array(json.dumps(header)), **arrays)
    write_bytes(path, content.getvalue())


def load_predictions(path: Path) -> Predictions:
    """Read a file; nothing in it is run.

    Raises:
        PredictionsError: it is missing, damaged, of another kind or of a later version.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            header = json.loads(str(stored["header"]))
            arrays = {key: stored[key] for key in _ARRAYS}
    except FileNotFoundError as error:
        raise PredictionsError(f"{path} does not exist; give what evaluate wrote") from error
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise PredictionsError(f"{path} is no predictions file of uasthn evaluate") from error
    if header.pop("format", None) != _FORMAT:
        raise PredictionsError(f"{path} was written by another version: evaluate again")
    try:
        settings = Settings(**(header | {"weights": tuple(header["weights"])}))
    except (TypeError, KeyError) as error:
        raise PredictionsError(f"{path} was written by another version: evaluate again") from error
    _check_shapes(path, arrays)
    return Predictions(settings, **arrays)


def _check_shapes(path: Path, arrays: dict[str, Any]) -> None:
    count = len(arrays["name"])
    shapes = {"true_px": (4, 2), "prior_px": (4, 2), "modelled_std_px": (4, 2), "seconds": (3,)}
    ok = all(arrays[key].shape == (count, *shape) for key, shape in shapes.items())
    answers = arrays["answers_px"]
    ok &= answers.ndim == 5 and answers.shape[0] == count and answers.shape[3:] == (4, 2)
    if not (ok and count):
        raise PredictionsError(f"{path} holds no samples, or arrays that do not fit together")
