"""Which networks a run opens, and what these know of themselves."""

from pathlib import Path

import pytest
from small_displacement_models import fixed_weights, small_weights

from uasthn_cli.config import CropTtaConfig, DecisionConfig, GeotagConfig, UeMethod
from uasthn_cli.errors import WeightsError
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.matching.ncc import NccEstimator
from uasthn_cli.matching.registry import XCORR
from uasthn_cli.pipeline import GeotagJob
from uasthn_cli.pipeline.estimators import (
    open_base,
    open_members,
    says_deviations,
    settled_uncertainty,
)


def job(config: GeotagConfig, *weights: Path) -> GeotagJob:
    return GeotagJob(
        log_path=Path("none.tlog"),
        frames_path=Path("none"),
        map_path=Path("none.tif"),
        camera=CameraSpec(hfov_deg=45.0),
        config=config,
        weights=weights,
    )


def test_the_first_file_is_the_base_network_and_the_others_are_members(tmp_path: Path) -> None:
    files = [small_weights(tmp_path, "ihn", seed) for seed in (1, 2, 3)]
    config = GeotagConfig(estimator="ihn", device="cpu")
    assert open_base(job(config, *files)).name == "ihn"
    assert [member.name for member in open_members(job(config, *files))] == ["ihn", "ihn"]
    assert open_members(job(config, files[0])) == []


def test_xcorr_is_one_estimator_of_all_its_networks() -> None:
    asked = job(GeotagConfig(device="cpu", symmetries=2), *XCORR.bundled_weights[:2])
    assert open_members(asked) == []
    assert len(open_base(asked)._members) == 2  # type: ignore[attr-defined]


def test_a_second_head_is_known_once_weights_are_read(tmp_path: Path) -> None:
    plain = fixed_weights(tmp_path / "plain.safetensors")
    headed = fixed_weights(tmp_path / "headed.safetensors", log_variance=0.0)
    config = GeotagConfig(estimator="ihn", device="cpu", ue=UeMethod.DM)
    said = settled_uncertainty(job(config, headed), open_base(job(config, headed)))
    assert said.method is UeMethod.DM
    with pytest.raises(WeightsError, match=r"plain\.safetensors: dm needs a network with a second"):
        settled_uncertainty(job(config, plain), open_base(job(config, plain)))
    assert not says_deviations(NccEstimator())


def test_a_limit_that_turns_out_to_have_nothing_to_limit_is_refused(tmp_path: Path) -> None:
    plain = fixed_weights(tmp_path / "plain.safetensors")
    limit = DecisionConfig(max_std_m=5.0)
    config = GeotagConfig("ihn", device="cpu", crops=CropTtaConfig(views=1), decision=limit)
    with pytest.raises(WeightsError, match="--ue none has none"):
        settled_uncertainty(job(config, plain), open_base(job(config, plain)))
