"""One run of the protocol into its predictions file, which a killed run goes on from."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from uasthn_cli.datasets.samples import MatchDataset
from uasthn_cli.errors import DatasetError, OutputError
from uasthn_cli.evaluation.predictions import (
    Prediction,
    Predictions,
    Settings,
    gathered,
    load_predictions,
    save_predictions,
    scattered,
)
from uasthn_cli.evaluation.protocol import ProtocolConfig, predict
from uasthn_cli.seam import Estimator

SAVE_EVERY_S: Final = 30.0


def predict_to_file(
    path: Path,
    dataset: MatchDataset,
    estimators: Sequence[Estimator],
    settings: Settings,
    config: ProtocolConfig,
    *,
    overwrite: bool = False,
    on_sample: Callable[[int], None] = lambda _: None,
) -> Predictions:
    """Predict all samples, or those that a file of the same settings lacks, and save the file.

    Raises:
        OutputError: the file is of other settings and ``overwrite`` is false, or cannot be written.
        PredictionsError: what is there is no predictions file.
        DatasetError: the data set is empty.
    """
    if not len(dataset):
        raise DatasetError(f"{settings.dataset}: no sample is left to evaluate")
    done = [] if overwrite else _done_before(path, settings, len(dataset))
    saved_s = time.monotonic()
    for prediction in predict(dataset, estimators, config, start=len(done)):
        done.append(prediction)
        on_sample(len(done))
        if time.monotonic() - saved_s > SAVE_EVERY_S:
            save_predictions(path, gathered(settings, done))
            saved_s = time.monotonic()
    predictions = gathered(settings, done)
    save_predictions(path, predictions)
    return predictions


def _done_before(path: Path, settings: Settings, samples: int) -> list[Prediction]:
    """Return what a file of the same settings holds already."""
    if not path.exists():
        return []
    before = load_predictions(path)
    if before.settings != settings or len(before) > samples:
        raise OutputError(
            f"{path} was made with other settings; choose another --out or give --overwrite"
        )
    return scattered(before)
