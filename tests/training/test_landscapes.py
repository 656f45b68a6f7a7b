"""Rendered landscapes as scenes: map and night views show the same square of the same place."""

from collections.abc import Iterator

import numpy as np
import pytest
from tiny_training import pattern

from uasthn_cli.synth.kinds import LandscapeKind
from uasthn_cli.synth.landscape import render_landscape
from uasthn_cli.training import landscapes
from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.fields import standardise
from uasthn_cli.training.landscapes import RenderedLandscape


@pytest.fixture
def _small(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(landscapes, "LANDSCAPE_PX", 160)
    landscapes._landscape.cache_clear()
    yield
    landscapes._landscape.cache_clear()


def test_convention_map_and_night_views_show_the_same_square(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ground = pattern(0, 240, 240)
    rgb = np.repeat((ground * 255).astype(np.uint8)[..., None], 3, axis=-1)
    monkeypatch.setattr(landscapes, "_landscape", lambda *_: (rgb, ground.astype(np.float16)))
    monkeypatch.setattr(
        landscapes, "thermal_from_colour", lambda _, colour, __: standardise(colour[..., 0])
    )
    for seed in range(4):
        seen, views = RenderedLandscape(0).render(
            np.random.default_rng(seed), 20, 60, 150, 150, EngineConfig()
        )
        square = ground[20:170, 60:210]
        assert seen[..., 0] == pytest.approx(square, abs=1 / 250)
        assert len(views) == 2
        for view in views:
            assert standardise(view) == pytest.approx(standardise(square), abs=0.02)


@pytest.mark.usefixtures("_small")
def test_a_landscape_renders_alike_every_time_and_unlike_the_next() -> None:
    def render(index: int) -> tuple[np.ndarray, np.ndarray]:
        landscapes._landscape.cache_clear()
        rgb, (view, _) = RenderedLandscape(index).render(
            np.random.default_rng(0), 5, 9, 130, 100, EngineConfig()
        )
        return rgb, view

    first, again, other = render(1), render(1), render(2)
    assert all(map(np.array_equal, first, again))
    assert not np.array_equal(first[0], other[0])
    assert first[0].shape == (100, 100, 3)
    assert first[0].dtype == first[1].dtype == np.float32
    assert 0 <= first[0].min() < first[0].max() <= 1
    assert np.isfinite(first[1]).all()


@pytest.mark.usefixtures("_small")
def test_kinds_take_turns_and_ground_sizes_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    kinds, sizes_m = [], []

    def remember(seed: int, shape: tuple[int, int], gsd_m: float, *, kind: LandscapeKind) -> object:
        kinds.append(kind)
        sizes_m.append(gsd_m)
        return render_landscape(seed, (32, 32), gsd_m, kind=kind)

    monkeypatch.setattr(landscapes, "render_landscape", remember)
    count = len(LandscapeKind)
    for index in range(count):
        RenderedLandscape(index).render(np.random.default_rng(0), 0, 0, 32, 32, EngineConfig())
    assert set(kinds) == set(LandscapeKind)
    assert len(set(sizes_m)) == count
    assert 0.3 <= min(sizes_m) < max(sizes_m) <= 10
    sizes_m.clear()
    for index in range(count):
        RenderedLandscape(index).render(
            np.random.default_rng(0), 0, 0, 32, 32, EngineConfig(scale_range=False)
        )
    assert len(sizes_m) == count
    assert len(set(sizes_m)) == 1
