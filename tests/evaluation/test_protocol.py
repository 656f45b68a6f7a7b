from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_estimator import SETTINGS, KnownPairs, ShiftEstimator, refuse

from uasthn_cli.config import CropTtaConfig
from uasthn_cli.errors import DatasetError, OutputError
from uasthn_cli.evaluation.predictions import gathered, load_predictions
from uasthn_cli.evaluation.protocol import WARM_UP_RUNS, ProtocolConfig, predict
from uasthn_cli.evaluation.run import predict_to_file
from uasthn_cli.matching.ncc import NccEstimator
from uasthn_cli.seam import Estimate
from uasthn_cli.types import FloatArray

PAIRS = KnownPairs(((10.0, -6.0), (4.0, 4.0), (0.0, 0.0)))


def test_all_views_of_an_ideal_estimator_agree_on_the_truth() -> None:
    pairs = KnownPairs(((10.0, -6.0),))
    (found,) = predict(pairs, [ShiftEstimator((10.0, -6.0))], ProtocolConfig())
    assert found.answers_px.shape == (1, 5, 4, 2)
    np.testing.assert_allclose(found.answers_px[0], np.stack([found.true_px] * 5), atol=1e-9)
    assert found.gsd_m == 2.0
    assert found.confidence == 0.5


def test_shifts_at_the_matched_width_come_back_in_the_data_s_pixels() -> None:
    pairs = KnownPairs(((10.0, -6.0),))
    (found,) = predict(pairs, [ShiftEstimator((5.0, -3.0))], ProtocolConfig(width_px=24))
    np.testing.assert_allclose(found.answers_px[0, 0], found.true_px, atol=1e-9)


def test_members_see_the_full_frame_only() -> None:
    base, member = ShiftEstimator(), ShiftEstimator((1.0, 0.0))
    (found,) = predict(KnownPairs(((0.0, 0.0),)), [base, member], ProtocolConfig())
    assert np.isfinite(found.answers_px[:, 0]).all()
    assert np.isnan(found.answers_px[1, 1:]).all()
    assert set(member.views) == {1}
    np.testing.assert_allclose(found.answers_px[1, 0] - found.answers_px[0, 0], [[1.0, 0.0]] * 4)


def test_warm_up_is_not_measured_and_one_view_is_timed_beside_all() -> None:
    estimator = ShiftEstimator()
    found = list(predict(PAIRS, [estimator], ProtocolConfig()))
    assert estimator.views == [5, 1] * (WARM_UP_RUNS + len(PAIRS))
    seconds = np.stack([one.seconds for one in found])
    assert (seconds[:, :2] > 0.0).all()
    assert (seconds[:, 2] == 0.0).all()


def test_one_view_is_not_timed_twice() -> None:
    estimator = ShiftEstimator()
    config = ProtocolConfig(CropTtaConfig(views=1))
    found = list(predict(PAIRS, [estimator], config))
    assert set(estimator.views) == {1}
    assert len(estimator.views) == WARM_UP_RUNS + len(PAIRS)
    assert all(one.seconds[0] == one.seconds[1] for one in found)


def test_one_bad_view_spoils_no_other_and_a_frame_without_an_answer_is_kept() -> None:
    def spoil(found_px: FloatArray) -> None:
        if len(found_px) > 1:
            found_px[2] = found_px[2, 0]

    (found,) = predict(KnownPairs(((0.0, 0.0),)), [ShiftEstimator(spoil=spoil)], ProtocolConfig())
    is_known = np.isfinite(found.answers_px[0]).all(axis=(1, 2))
    assert is_known.tolist() == [True, True, False, True, True]
    (lost,) = predict(KnownPairs(((0.0, 0.0),)), [ShiftEstimator(spoil=refuse)], ProtocolConfig())
    assert np.isnan(lost.answers_px).all()
    assert lost.confidence == 0.0


def test_ncc_finds_a_picture_in_itself() -> None:
    pairs = KnownPairs(((10.0, -6.0),))
    sample = pairs[0]
    x, y = (round(value) for value in sample.corners_px[0])
    cut = sample.satellite[y : y + 48, x : x + 48].mean(axis=2).astype(np.uint8)

    class Cut(KnownPairs):
        def __getitem__(self, index: int):  # type: ignore[no-untyped-def]  # noqa: ANN204
            return replace(sample, thermal=cut)

    (found,) = predict(Cut(pairs.offsets_px), [NccEstimator()], ProtocolConfig())
    np.testing.assert_allclose(found.answers_px[0, 0], sample.corners_px, atol=0.6)


def test_a_killed_run_goes_on_where_it_was(tmp_path: Path) -> None:
    path = tmp_path / "predictions.npz"
    first = KnownPairs(PAIRS.offsets_px[:2])
    predict_to_file(path, first, [ShiftEstimator()], SETTINGS, ProtocolConfig())
    counts: list[int] = []
    estimator = ShiftEstimator()
    all_of_them = predict_to_file(
        path, PAIRS, [estimator], SETTINGS, ProtocolConfig(), on_sample=counts.append
    )
    assert counts == [3]
    whole = gathered(SETTINGS, list(predict(PAIRS, [ShiftEstimator()], ProtocolConfig())))
    np.testing.assert_array_equal(all_of_them.answers_px, whole.answers_px)
    np.testing.assert_array_equal(load_predictions(path).answers_px, whole.answers_px)


def test_other_settings_are_not_mixed_in(tmp_path: Path) -> None:
    path = tmp_path / "predictions.npz"
    config = ProtocolConfig()
    predict_to_file(path, PAIRS, [ShiftEstimator()], SETTINGS, config)
    other = replace(SETTINGS, seed=1)
    with pytest.raises(OutputError, match="made with other settings"):
        predict_to_file(path, PAIRS, [ShiftEstimator()], other, config)
    predict_to_file(path, PAIRS, [ShiftEstimator()], other, config, overwrite=True)
    assert load_predictions(path).settings.seed == 1


def test_nothing_to_evaluate_is_said(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no sample is left"):
        predict_to_file(
            tmp_path / "a.npz", KnownPairs(()), [ShiftEstimator()], SETTINGS, ProtocolConfig()
        )


class Outspoken(ShiftEstimator):
    """An estimator that states deviations of its own."""

    def estimate(self, *what: Any) -> Estimate:
        return replace(super().estimate(*what), modelled_std_px=np.full((4, 2), 1.5))


def test_what_a_network_says_of_its_error_comes_back_in_the_data_s_pixels() -> None:
    config = ProtocolConfig(width_px=24)  # half of the data's own width
    (found,) = predict(KnownPairs(((0.0, 0.0),)), [Outspoken()], config)
    np.testing.assert_allclose(found.modelled_std_px, np.full((4, 2), 3.0))
    (silent,) = predict(KnownPairs(((0.0, 0.0),)), [ShiftEstimator()], config)
    assert np.isnan(silent.modelled_std_px).all()
