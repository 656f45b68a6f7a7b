"""A run from pairs to weights that estimators open; interrupted anywhere, the same files."""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import torch
from small_displacement_models import small_model, small_weights
from tiny_displacement import PatternPairs, tiny_displacement_config
from tiny_tgm import write_tiny_generator
from torch import Tensor

from uasthn_cli.errors import OutputError, TrainingDataError, WeightsError
from uasthn_cli.matching.displacement.checkpoints import load_displacement
from uasthn_cli.matching.registry import open_estimator
from uasthn_cli.training.displacement.network import build_network, read_initial_model
from uasthn_cli.training.displacement.run import DisplacementJob, DisplacementRun
from uasthn_cli.training.tgm.thermal_generator import open_generator_file


@pytest.fixture(autouse=True)
def _keep_malloc(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("uasthn_cli.training.displacement.trainee.keep_freed_memory", lambda: None)


def job(folder: Path, network: str = "dhn", **changes: Any) -> DisplacementJob:
    """Return a run of a small network, begun from random weights in a file."""
    folder.mkdir(exist_ok=True)
    settings: dict[str, Any] = {
        "out": folder / "w.safetensors",
        "dataset": PatternPairs(4),
        "source": "patterns",
        "config": tiny_displacement_config(network=network),
        "validation": PatternPairs(2, first_seed=100),
        "validate_every": 2,
        "licence_note": "made up",
        "command_line": "uasthn train patterns",
        "initial_weights": small_weights(folder, network),
    }
    return DisplacementJob(**(settings | changes))


def finish(asked: DisplacementJob) -> DisplacementRun:
    run = DisplacementRun(asked)
    list(run.train(lambda _: None))
    run.export()
    return run


def results(run: DisplacementRun) -> tuple[bytes, bytes, list[Any]]:
    log = pd.read_csv(run.paths.log).drop(columns="seconds")
    return run.paths.weights.read_bytes(), run.paths.card.read_bytes(), log.to_numpy().tolist()


def test_weights_card_and_log(tmp_path: Path) -> None:
    run = finish(job(tmp_path))
    model = load_displacement(run.paths.weights)
    assert model.name == "dhn"
    assert model.settings.width_ratio == 3.0
    assert model.notes["licence_note"] == "made up" and model.notes["steps"] == "4"
    assert open_estimator("dhn", weights=[run.paths.weights]).name == "dhn"
    card = run.paths.card.read_text("utf-8")
    assert "Pairs of `patterns`." in card
    assert "uasthn train patterns" in card
    assert "started from | `dhn.safetensors`" in card
    assert "| median error |" in card
    table = pd.read_csv(run.paths.log)
    assert list(table["step"]) == [2, 4]
    assert table["validation_median_error_px"].notna().all()


def test_an_interrupted_run_ends_with_the_same_files(tmp_path: Path) -> None:
    unbroken = results(finish(job(tmp_path / "a")))
    stopped = job(tmp_path / "b")
    next(DisplacementRun(stopped).train(lambda _: None))
    resumed = DisplacementRun(stopped)
    assert resumed.saved_step == 2
    assert results(finish(stopped)) == unbroken


@pytest.mark.parametrize("network", ["ihn", "sthn"])
def test_iterated_networks_become_estimators_too(network: str, tmp_path: Path) -> None:
    asked = job(tmp_path, network)
    run = finish(replace(asked, config=replace(asked.config, steps=2, batch=1), validation=None))
    model = load_displacement(run.paths.weights)
    assert model.name == network
    assert (model.settings.iterations, model.settings.second_iterations) == (2, 1)
    assert model.settings.box_padding == 32 / 1536
    assert "None: no other pairs" in run.paths.card.read_text("utf-8")
    assert open_estimator(network, weights=[run.paths.weights]).name == network


def drawn_job(folder: Path, share: float = 0.5, gsd_m: float = 2.0) -> DisplacementJob:
    """Return a run in which a generator draws a share of the thermal images."""
    asked = job(folder, config=tiny_displacement_config(network="dhn", tgm_share=share))
    weights = write_tiny_generator(folder / "tgm.safetensors", gsd_m=gsd_m)
    return replace(asked, thermal=open_generator_file(weights, "cpu"))


def test_drawn_thermal_images_are_learnt_and_told_of(tmp_path: Path) -> None:
    plain, drawn = finish(job(tmp_path / "a")), finish(drawn_job(tmp_path / "b"))
    assert results(drawn)[0] != results(plain)[0]
    assert results(drawn) == results(finish(drawn_job(tmp_path / "c")))
    digest = hashlib.sha256((tmp_path / "b" / "tgm.safetensors").read_bytes()).hexdigest()
    told = "The thermal images of 50% were drawn from the satellite images by `tgm.safetensors`"
    assert f"{told}, SHA-256 {digest}." in drawn.paths.card.read_text("utf-8")
    assert "were drawn" not in plain.paths.card.read_text("utf-8")


def test_a_run_goes_on_with_its_own_generator_alone(tmp_path: Path) -> None:
    next(DisplacementRun(drawn_job(tmp_path)).train(lambda _: None))
    for other in (drawn_job(tmp_path, gsd_m=3.0), job(tmp_path)):
        with pytest.raises(TrainingDataError, match="begun with another --tgm;"):
            DisplacementRun(other)
    with pytest.raises(TrainingDataError, match=r"another --tgm-share \(0.5, now 0.25\)"):
        DisplacementRun(drawn_job(tmp_path, share=0.25))
    assert DisplacementRun(drawn_job(tmp_path)).saved_step == 2


def test_pairs_that_are_learnt_from_judge_nothing(tmp_path: Path) -> None:
    with pytest.raises(TrainingDataError, match="to judge by are those to learn from"):
        DisplacementRun(job(tmp_path, validation=PatternPairs(4)))


def test_files_that_are_there_are_kept(tmp_path: Path) -> None:
    asked = job(tmp_path)
    asked.out.write_bytes(b"mine")
    with pytest.raises(OutputError, match="--overwrite"):
        DisplacementRun(asked)
    assert asked.out.read_bytes() == b"mine"


def test_a_frozen_stage_needs_weights(tmp_path: Path) -> None:
    frozen = tiny_displacement_config(network="sthn", first_stage="frozen")
    asked = job(tmp_path, "sthn", config=frozen, initial_weights=None)
    with pytest.raises(TrainingDataError, match="give --init"):
        DisplacementRun(asked)


def test_the_ratio_is_that_of_the_initial_weights(tmp_path: Path) -> None:
    asked = job(tmp_path)
    run = DisplacementRun(asked)
    assert run._trainee.settings["width_ratio"] == small_model("dhn").settings.width_ratio


def test_an_ihn_begins_a_first_stage_and_a_new_head_is_random(tmp_path: Path) -> None:
    path = small_weights(tmp_path, "ihn")
    config = tiny_displacement_config(network="sthn", direct_modeling=True)
    network = build_network(config, read_initial_model(path, "sthn"))
    state = network.state_dict()
    for name, value in load_displacement(path).network.state_dict().items():
        assert torch.equal(state[f"netG.{name}"], value)
    assert any(name.startswith("netG.ue_update_block_4.") for name in state)
    plain = build_network(tiny_displacement_config(), read_initial_model(path, "ihn"))
    assert not any(name.startswith("ue_") for name in plain.state_dict())


def test_a_dhn_takes_up_or_drops_a_second_head(tmp_path: Path) -> None:
    def begun(name: str, *, direct_modeling: bool) -> Mapping[str, Tensor]:
        config = tiny_displacement_config(network="dhn", direct_modeling=direct_modeling)
        initial = read_initial_model(small_weights(tmp_path, name), "dhn")
        return build_network(config, initial).state_dict()

    plain, modelling = (small_model(name).network.state_dict() for name in ("dhn", "dhn+dm"))
    grown, kept = (begun(name, direct_modeling=True) for name in ("dhn", "dhn+dm"))
    cut = begun("dhn+dm", direct_modeling=False)
    assert grown.keys() == kept.keys() == modelling.keys()
    assert cut.keys() == plain.keys()
    assert all(torch.equal(grown[name], plain[name]) for name in plain)
    assert all(torch.equal(kept[name], modelling[name]) for name in modelling)


@pytest.mark.parametrize(("weights", "network"), [("dhn", "ihn"), ("ihn", "dhn")])
def test_weights_of_another_kind_are_no_beginning(
    weights: str, network: Any, tmp_path: Path
) -> None:
    with pytest.raises(WeightsError, match=f"weights of {weights} are no beginning for {network}"):
        read_initial_model(small_weights(tmp_path, weights), network)


def test_members_of_an_ensemble_differ_by_their_seed() -> None:
    first, second, again = (
        build_network(tiny_displacement_config(network="dhn", seed=seed)).state_dict()
        for seed in (0, 1, 0)
    )
    assert all(torch.equal(first[name], again[name]) for name in first)
    assert any(not torch.equal(first[name], second[name]) for name in first)
