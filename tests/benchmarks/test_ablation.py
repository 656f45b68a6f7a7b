"""Arms differ in one thing each; what is finished becomes a table."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from ablation import ARMS, FRAMES, Arm, slug, summarise, table
from held import FrameScore, ProbedXcorr

from uasthn_cli.geometry.corners import image_corners_px
from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.training.engine import PARTS
from uasthn_cli.types import GridBox, MapFeatures, MapGrid, Ortho


def score(ce_m: float, log_posterior: float = -1.0) -> FrameScore:
    return FrameScore("f", ce_m, 0.0, ce_m, log_posterior)


def test_arms_have_names_of_their_own_and_switch_off_every_part() -> None:
    assert len({slug(name) for name in ARMS}) == len(ARMS)
    assert {part for arm in ARMS.values() for part in arm.without} == set(PARTS)
    assert len({(a.without, a.imagery, a.rendered, a.seed) for a in ARMS.values()}) == len(ARMS)
    assert next(iter(ARMS.values())) == Arm()


def test_summary_of_frames() -> None:
    summary = summarise([score(5.0, -1.0), score(20.0, -2.0), score(300.0, -3.0)])
    assert summary.ce_median_m == 20
    assert summary.within_25m == pytest.approx(2 / 3)
    assert summary.hit_ce_median_m == summary.hit_east_median_m == 12.5
    assert summary.hit_north_median_m == 0
    assert summary.log_posterior == -2


def test_table_of_finished_arms_says_what_chance_does(tmp_path: Path) -> None:
    for name, ce_m in (("full recipe, seed 0", 6.0), ("full recipe, seed 1", 8.0)):
        scores = {frames: [asdict(score(ce_m))] for frames in FRAMES}
        (tmp_path / f"{slug(name)}.json").write_text(json.dumps({"scores": scores}))
    lines = table(tmp_path).splitlines()
    rows = {line.split("|")[1].strip(): line.split("|")[2].strip() for line in lines if "|" in line}
    assert rows["full recipe, seed 0"] == "6.0"
    assert rows["full recipe: mean of 2"] == "7.0"
    assert rows["full recipe: deviation"] == "1.4"
    assert "without relief" not in rows
    assert sum(line.startswith("**") for line in lines) == 3


def test_posterior_is_sure_of_the_place_where_the_search_peaks() -> None:
    probe = ProbedXcorr(XcorrModel(XcorrArchitecture(4, (4, 4, 4, 4))))
    window, thermal, gsd_m = 128, 48, 2.0
    grid, box = MapGrid(gsd_m), GridBox(0, 0, window, window)
    cells = np.random.default_rng(0).standard_normal((4, window // 2, window // 2))
    features = MapFeatures(cells, np.ones((window // 2, window // 2), np.bool_), box, grid, 2)
    seen = np.random.default_rng(1).random((thermal, thermal), dtype=np.float32)
    middle = np.full(2, (thermal - 1) / 2)
    ortho = Ortho(seen, np.ones(seen.shape, np.bool_), gsd_m, np.eye(3), middle)
    start_px = np.full(2, (window - thermal) / 2)
    estimate = probe.estimate(features, ortho, image_corners_px(thermal, thermal)[None], start_px)
    found_px = estimate.corners_px[0].mean(axis=0)
    finite = np.isfinite(probe.scores)
    assert 0 < finite.sum() < finite.size, "beyond the disk nothing counts"
    # An untrained network's peak is low, and how low differs from machine to machine.
    rank = np.searchsorted(np.sort(probe.scores[finite]), probe.scores)
    probe.scores = np.where(finite, np.where(rank == finite.sum() - 1, 20.0, 0.0), -np.inf)
    assert probe.log_posterior(found_px, 6.0) > np.log(0.5)
    assert probe.log_posterior(found_px + 30.0, 6.0) < np.log(0.1)
