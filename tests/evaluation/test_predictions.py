import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from known_estimator import made_up_predictions

from uasthn_cli.errors import PredictionsError
from uasthn_cli.evaluation.predictions import (
    Predictions,
    gathered,
    load_predictions,
    save_predictions,
    scattered,
)

SOME = made_up_predictions(np.array([1.0, 40.0]), np.array([2.0, 30.0]), members=3)


def test_there_and_back(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    save_predictions(path, SOME)
    found = load_predictions(path)
    assert found.settings == SOME.settings
    for field in fields(Predictions)[1:]:
        np.testing.assert_array_equal(getattr(found, field.name), getattr(SOME, field.name))
    again = gathered(found.settings, scattered(found))
    np.testing.assert_array_equal(again.answers_px, SOME.answers_px)


def test_the_same_predictions_give_the_same_bytes(tmp_path: Path) -> None:
    save_predictions(tmp_path / "a.npz", SOME)
    save_predictions(tmp_path / "b.npz", SOME)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_what_is_no_predictions_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PredictionsError, match="does not exist"):
        load_predictions(tmp_path / "none.npz")
    for name, content in (("text.npz", b"no"), ("empty.npz", b""), ("zip.npz", b"PK\x03\x04")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(PredictionsError, match="is no predictions file"):
            load_predictions(tmp_path / name)
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(PredictionsError, match="is no predictions file"):
        load_predictions(tmp_path / "other.npz")
    np.savez(tmp_path / "pickled.npz", header=np.array([{}], dtype=object))
    with pytest.raises(PredictionsError, match="is no predictions file"):
        load_predictions(tmp_path / "pickled.npz")


def test_another_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    save_predictions(path, SOME)
    with np.load(path) as stored:
        arrays = dict(stored)
    header = str(arrays["header"])
    np.savez(path, **(arrays | {"header": np.array(header.replace('"format": 1', '"format": 2'))}))
    with pytest.raises(PredictionsError, match="another version"):
        load_predictions(path)
    np.savez(path, **(arrays | {"header": np.array(header.replace('"views"', '"eyes"'))}))
    with pytest.raises(PredictionsError, match="another version"):
        load_predictions(path)
    np.savez(path, **(arrays | {"true_px": arrays["true_px"][:1]}))
    with pytest.raises(PredictionsError, match="do not fit together"):
        load_predictions(path)


def test_nothing_but_arrays_is_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    save_predictions(path, SOME)
    with zipfile.ZipFile(path) as archive:
        assert all(name.endswith(".npy") for name in archive.namelist())
