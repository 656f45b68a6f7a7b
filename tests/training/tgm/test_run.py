"""A run from pairs to weights: interrupted anywhere, it ends with the same files."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from tiny_tgm import ListedPairs, listed_pairs, tiny_tgm_config

from uasthn_cli.errors import OutputError, TrainingDataError
from uasthn_cli.training.tgm.run import TgmJob, TgmRun
from uasthn_cli.training.tgm.weights import load_generator


@pytest.fixture
def job(tmp_path: Path) -> TgmJob:
    return TgmJob(
        out=tmp_path / "a" / "t.safetensors",
        dataset=listed_pairs(),
        source="made up",
        config=tiny_tgm_config(batch=3),
        validation=listed_pairs(2, first=20),
        licence_note="mine",
    )


def finish(job: TgmJob) -> TgmRun:
    run = TgmRun(job)
    for _ in run.train(lambda _: None):
        pass
    run.export()
    return run


def results(run: TgmRun) -> tuple[bytes, bytes, list[Any]]:
    """Return what must not depend on interruptions: weights, card, and the log but for time."""
    log = pd.read_csv(run.paths.log).drop(columns="seconds")
    return run.paths.weights.read_bytes(), run.paths.card.read_bytes(), log.to_numpy().tolist()


def elsewhere(job: TgmJob, folder: str) -> TgmJob:
    return replace(job, out=job.out.parents[1] / folder / job.out.name)


def interrupt_at(step: int) -> Callable[[int], None]:
    def on_step(done: int) -> None:
        if done == step:
            raise KeyboardInterrupt

    return on_step


def test_all_files_are_there_and_nothing_else(job: TgmJob) -> None:
    run = finish(job)
    names = sorted(path.name for path in job.out.parent.iterdir())
    assert names == ["t.checkpoint.pt", "t.log.csv", "t.md", "t.safetensors"]
    loaded = load_generator(job.out)
    assert loaded.architecture == job.config.architecture
    assert loaded.size_px == 64
    assert loaded.gsd_m == pytest.approx(2.5)
    table = pd.read_csv(run.paths.log)
    assert list(table["step"]) == [2, 4]
    assert table.notna().all(axis=None)
    card = run.paths.card.read_text("utf-8")
    assert "3 pairs of `made up`, 64 px of 2.5 m" in card
    assert "Licence note: mine" in card
    assert f"never drew: {table['validation_l1_grey'].iloc[-1]:.1f} of 255" in card


@pytest.mark.parametrize("stop", [2, 3])
def test_an_interrupted_run_ends_with_the_same_bytes(job: TgmJob, stop: int) -> None:
    unbroken = results(finish(job))
    assert results(finish(elsewhere(job, "again"))) == unbroken
    stopped = TgmRun(elsewhere(job, "stopped"))
    with pytest.raises(KeyboardInterrupt):
        list(stopped.train(interrupt_at(stop)))
        pytest.fail("nobody interrupted")
    resumed = TgmRun(elsewhere(job, "stopped"))
    assert resumed.saved_step == (2 if stop == 3 else 0)
    assert not resumed.paths.weights.exists()
    assert results(finish(elsewhere(job, "stopped"))) == unbroken


def test_another_seed_is_another_generator(job: TgmJob) -> None:
    weights = finish(job).paths.weights.read_bytes()
    other = elsewhere(replace(job, config=tiny_tgm_config(batch=3, seed=1)), "other")
    assert finish(other).paths.weights.read_bytes() != weights


def test_finished_weights_are_not_replaced_unasked(job: TgmJob) -> None:
    before = results(finish(job))
    with pytest.raises(OutputError, match="--overwrite"):
        TgmRun(job)
    assert results(finish(replace(job, overwrite=True))) == before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dataset": listed_pairs(first=7)}, "another data set"),
        ({"config": tiny_tgm_config(batch=3, seed=5)}, r"another --seed \(0, now 5\)"),
        ({"config": tiny_tgm_config(batch=2)}, r"another --batch \(3, now 2\)"),
        ({"config": tiny_tgm_config(batch=3, steps=1)}, "already at step 2"),
    ],
)
def test_a_checkpoint_of_another_run_is_refused(
    job: TgmJob, change: dict[str, Any], message: str
) -> None:
    next(TgmRun(job).train(lambda _: None))
    with pytest.raises(TrainingDataError, match=message):
        TgmRun(replace(job, **change))


def test_more_steps_go_on_from_a_finished_run_and_the_card_says_so(job: TgmJob) -> None:
    finish(job)
    run = finish(replace(job, config=tiny_tgm_config(batch=3, steps=6), overwrite=True))
    assert run.changes == ["from step 4: steps 6 instead of 4"]
    assert run.changes[0] in run.paths.card.read_text("utf-8")


def test_pairs_to_judge_by_must_be_others(job: TgmJob) -> None:
    with pytest.raises(TrainingDataError, match="give others"):
        TgmRun(replace(job, validation=listed_pairs()))
    with pytest.raises(TrainingDataError, match="holds no pair"):
        TgmRun(replace(job, validation=ListedPairs([])))


def test_without_pairs_to_judge_by_the_card_says_so(job: TgmJob) -> None:
    run = finish(replace(job, validation=None))
    assert "No other pairs were given to judge by." in run.paths.card.read_text("utf-8")
    assert pd.read_csv(run.paths.log)["validation_l1_grey"].isna().all()


def test_images_must_fit_the_network(job: TgmJob) -> None:
    with pytest.raises(ValueError, match="no multiple of 32 px"):
        TgmRun(replace(job, config=tiny_tgm_config(size_px=72)))
