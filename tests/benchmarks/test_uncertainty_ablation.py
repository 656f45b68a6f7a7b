"""Each ablation varies one thing, and everything else is the paper's choice."""

from pathlib import Path

import click
import pytest
from uncertainty_ablation import arms_of, selected

from uasthn_cli.config import CropTtaConfig, UeMethod

FILES = (Path("a.safetensors"), Path("b.safetensors"))


def test_an_ensemble_of_ihn_has_every_panel() -> None:
    arms = list(arms_of("ihn", FILES, ensemble=False, trained={"5": FILES[1]}))
    assert {arm.ablation for arm in arms} == {
        *("crops in training", "sampling", "crop offset", "number of views"),
        *("aggregation", "early stopping", "merge"),
    }
    for arm in arms:
        asks_all = arm.method in (UeMethod.DE, UeMethod.CROPTTA_DE)
        one = FILES[1:] if arm.ablation == "crops in training" else FILES[:1]
        assert arm.weights == (FILES if asks_all else one)


def test_every_panel_of_crops_holds_the_papers_choice_once() -> None:
    arms = list(arms_of("xcorr", (), ensemble=False, trained={}))
    for ablation in ("sampling", "crop offset", "number of views"):
        chosen = [arm for arm in arms if arm.ablation == ablation and arm.crops == CropTtaConfig()]
        assert len(chosen) == 1
    assert not any(arm.ablation in ("early stopping", "merge") for arm in arms)


def test_only_some_ablations() -> None:
    arms = list(arms_of("ihn", FILES, ensemble=False, trained={}))
    assert selected(arms, ()) == arms
    assert {arm.ablation for arm in selected(arms, ("merge", "sampling"))} == {"merge", "sampling"}
    with pytest.raises(click.UsageError, match=r"early stopping, merge"):
        selected(arms, ("crops in training",))
