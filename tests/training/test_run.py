"""A training run from images to weights: interrupted anywhere, it ends with the same files."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from tiny_training import tiny_config, write_photo

from uasthn_cli.errors import OutputError, TrainingDataError
from uasthn_cli.matching.torch_weights import load_xcorr
from uasthn_cli.training import loop
from uasthn_cli.training.run import TrainingJob, TrainingRun
from uasthn_cli.training.scenes import RenderedShares


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photos")
    for seed in range(2):
        write_photo(folder / f"{seed}.png", seed)
    return folder


@pytest.fixture(autouse=True)
def _short_validation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "_VALIDATION_BATCHES", 1)


@pytest.fixture
def job(photos: Path, tmp_path: Path) -> TrainingJob:
    return TrainingJob(
        out=tmp_path / "w.safetensors",
        images=((str(photos / "*.png"), 1.0),),
        rendered=RenderedShares(0.0, 0.0),
        config=tiny_config(),
        validate_every=2,
        licence_note="made up",
    )


def finish(job: TrainingJob) -> TrainingRun:
    run = TrainingRun(job)
    for _ in run.train(lambda _: None):
        pass
    run.export()
    return run


def results(run: TrainingRun) -> tuple[bytes, bytes, list[Any]]:
    """Return what must not depend on interruptions: weights, card, and the log but for time."""
    log = pd.read_csv(run.paths.log).drop(columns="seconds")
    return run.paths.weights.read_bytes(), run.paths.card.read_bytes(), log.to_numpy().tolist()


def test_all_files_are_there_and_nothing_else(job: TrainingJob) -> None:
    run = finish(job)
    names = sorted(path.name for path in job.out.parent.iterdir())
    assert names == ["w.checkpoint.pt", "w.log.csv", "w.md", "w.safetensors"]
    assert load_xcorr(job.out).model.architecture == job.config.architecture
    table = pd.read_csv(run.paths.log)
    assert list(table["step"]) == [2, 4]
    assert table["validation_within_4_px"].notna().all()
    assert f"| {2} | 1 |" in run.paths.card.read_text("utf-8")


def test_the_same_job_gives_the_same_bytes_and_an_interrupted_one_too(
    job: TrainingJob, tmp_path: Path
) -> None:
    unbroken = results(finish(job))

    def elsewhere(folder: str) -> TrainingJob:
        return replace(job, out=tmp_path / folder / job.out.name)

    assert results(finish(elsewhere("again"))) == unbroken
    stopped = TrainingRun(elsewhere("stopped"))
    next(stopped.train(lambda _: None))
    resumed = TrainingRun(elsewhere("stopped"))
    assert resumed.saved_step == 2
    assert results(finish(elsewhere("stopped"))) == unbroken


def interrupt_at(step: int) -> Callable[[int], None]:
    def on_step(done: int) -> None:
        if done == step:
            raise KeyboardInterrupt

    return on_step


def test_steps_after_the_last_checkpoint_are_done_again(job: TrainingJob, tmp_path: Path) -> None:
    unbroken = results(finish(job))
    job = replace(job, out=tmp_path / "other" / job.out.name)
    run = TrainingRun(job)
    with pytest.raises(KeyboardInterrupt):
        list(run.train(interrupt_at(3)))
    assert run.saved_step == 2
    assert not run.paths.weights.exists()
    assert results(finish(job)) == unbroken


def test_an_interruption_before_the_first_checkpoint_leaves_nothing(job: TrainingJob) -> None:
    run = TrainingRun(job)
    with pytest.raises(KeyboardInterrupt):
        list(run.train(interrupt_at(1)))
    assert run.saved_step == 0
    assert list(job.out.parent.iterdir()) == []


def test_validation_is_due_at_intervals_and_at_the_end(job: TrainingJob) -> None:
    config = tiny_config(steps=5, checkpoint_every=1)
    run = TrainingRun(replace(job, config=config, validate_every=3))
    reports = list(run.train(lambda _: None))
    assert [report.validation is not None for report in reports] == [
        False,
        False,
        True,
        False,
        True,
    ]


def test_finished_weights_are_not_replaced_unasked(job: TrainingJob) -> None:
    before = results(finish(job))
    with pytest.raises(OutputError, match="--overwrite"):
        TrainingRun(job)
    assert results(finish(replace(job, overwrite=True))) == before


def test_more_steps_go_on_from_a_finished_run_and_the_card_says_so(job: TrainingJob) -> None:
    finish(job)
    longer = replace(job, config=tiny_config(steps=6), overwrite=True)
    run = finish(longer)
    assert run.changes == ["from step 4: steps 6 instead of 4"]
    assert "from step 4: steps 6 instead of 4" in run.paths.card.read_text("utf-8")
    assert list(pd.read_csv(run.paths.log)["step"]) == [2, 4, 6]


def test_other_images_are_refused(job: TrainingJob, photos: Path) -> None:
    next(TrainingRun(job).train(lambda _: None))
    other = replace(job, images=((str(photos / "0.png"), 1.0),))
    with pytest.raises(TrainingDataError, match="another --images"):
        TrainingRun(other)


def test_without_images_no_file_is_made(job: TrainingJob, tmp_path: Path) -> None:
    gone = replace(job, images=((str(tmp_path / "gone/*.tif"), 1.0),))
    with pytest.raises(TrainingDataError, match="check --images"):
        TrainingRun(gone)
    assert list(tmp_path.iterdir()) == []
