"""Scenes: images by pattern and weight, dates of one place together, map and night view aligned."""

import logging
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
from affine import Affine
from numpy.typing import NDArray
from tiny_training import pattern, write_photo

from uasthn_cli.errors import TrainingDataError
from uasthn_cli.mapping.imagery import OverheadImage
from uasthn_cli.training import scenes
from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.landscapes import LANDSCAPES
from uasthn_cli.training.places import Places
from uasthn_cli.training.sand import SandScene
from uasthn_cli.training.scenes import (
    SAND_SCENES,
    ImageryScene,
    RenderedSand,
    RenderedShares,
    load_scenes,
)
from uasthn_cli.types import ImageArray

GSD_M = 5.0
IMAGERY_ONLY = RenderedShares(sand=0.0, landscapes=0.0)


def write_date(path: Path, level: int, *, east_m: float = 0.0, size: tuple[int, int]) -> Path:
    """Write a miniature GeoTIFF of one date, all of one grey level."""
    height_px, width_px = size
    transform = Affine(GSD_M, 0, 485_900 + east_m, 0, -GSD_M, 5_209_247)
    shape = {"height": height_px, "width": width_px, "count": 3, "dtype": "uint8"}
    with rasterio.open(
        path, "w", driver="GTiff", crs="EPSG:26914", transform=transform, **shape
    ) as target:
        target.write(np.full((3, height_px, width_px), level, np.uint8))
    return path


def imagery_of(scene: object) -> ImageryScene:
    assert isinstance(scene, ImageryScene)
    return scene


def test_dates_of_one_place_become_one_scene(tmp_path: Path) -> None:
    write_date(tmp_path / "2009.tif", 60, size=(150, 200))
    write_date(tmp_path / "2020.tif", 90, size=(149, 201), east_m=0.4 * GSD_M)
    write_date(tmp_path / "else.tif", 120, size=(150, 200), east_m=40 * GSD_M)
    found = load_scenes([(str(tmp_path / "*.tif"), 1.0)], IMAGERY_ONLY)
    dates, elsewhere = (imagery_of(scene).dates for scene in found.scenes)
    assert [int(date[0, 0, 0]) for date in dates] == [60, 90]
    assert {date.shape for date in dates} == {(149, 200, 3)}, "the part that all dates show"
    assert len(elsewhere) == 1
    assert found.sources[0].images == 3


@pytest.mark.parametrize(
    ("east_px", "is_same"),
    [(0.0, True), (0.45, True), (-0.45, True), (0.55, False), (-0.55, False), (1.0, False)],
)
def test_grids_agree_to_half_a_pixel(east_px: float, is_same: bool) -> None:
    def image(west_m: float) -> OverheadImage:
        return OverheadImage(np.zeros((9, 9, 3), np.uint8), ("EPSG:26914", west_m, 7.0, GSD_M))

    for start_px in (0.0, 0.25, 0.49, 0.5, 0.51, 0.75):  # wherever the grid begins
        places = Places()
        places.add(image(start_px * GSD_M))
        places.add(image((start_px + east_px) * GSD_M))
        assert len(list(places)) == (1 if is_same else 2)


def test_images_that_do_not_say_where_they_lie_are_places_of_their_own(tmp_path: Path) -> None:
    for seed in range(3):
        write_photo(tmp_path / f"{seed}.png", seed)
    found = load_scenes([(str(tmp_path / "*.png"), 1.0)], IMAGERY_ONLY)
    assert [len(imagery_of(scene).dates) for scene in found.scenes] == [1, 1, 1]


def test_weights_and_areas_become_probabilities(tmp_path: Path) -> None:
    write_photo(tmp_path / "a" / "small.png", 0, 200, 200)
    write_photo(tmp_path / "a" / "wide.png", 1, 200, 600)
    write_photo(tmp_path / "b" / "other.png", 2, 200, 300)
    patterns = [(str(tmp_path / "a/*"), 2.0), (str(tmp_path / "b/*"), 1.0)]
    found = load_scenes(patterns, RenderedShares(sand=0.3, landscapes=0.1))
    imagery, sand, landscapes = np.split(found.probabilities, (3, 3 + SAND_SCENES))
    assert imagery == pytest.approx([0.6 * 2 / 3 / 4, 0.6 * 2 / 3 * 3 / 4, 0.6 / 3])
    assert len(landscapes) == LANDSCAPES
    assert sand.sum() == pytest.approx(0.3)
    assert landscapes.sum() == pytest.approx(0.1)
    assert [(source.images, source.weight) for source in found.sources] == [(2, 2.0), (1, 1.0)]


def test_rendered_places_alone_need_no_image() -> None:
    found = load_scenes([], RenderedShares(sand=0.25, landscapes=0.75))
    assert len(found.scenes) == SAND_SCENES + LANDSCAPES
    assert found.probabilities.sum() == pytest.approx(1)
    assert len({scene.identity() for scene in found.scenes}) == len(found.scenes)


def test_unreadable_images_are_skipped_with_a_line(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_photo(tmp_path / "good.png")
    (tmp_path / "notes.txt").write_text("no image")
    with caplog.at_level(logging.WARNING, logger="uasthn_cli"):
        found = load_scenes([(str(tmp_path / "*"), 1.0)], IMAGERY_ONLY)
    assert len(found.scenes) == 1
    assert found.sources[0].images == 1
    lines = [r.getMessage() for r in caplog.records if r.name.startswith("uasthn_cli")]
    assert len(lines) == 1
    assert "notes.txt: skipped" in lines[0]


def test_nothing_to_train_on(tmp_path: Path) -> None:
    with pytest.raises(TrainingDataError, match="nothing to train on"):
        load_scenes([], IMAGERY_ONLY)
    with pytest.raises(TrainingDataError, match=r"matches '.*gone.*'; check --images"):
        load_scenes([(str(tmp_path / "gone*.tif"), 1.0)], RenderedShares(0.5, 0.0))
    write_photo(tmp_path / "small.png", height_px=100)
    with pytest.raises(TrainingDataError, match="at least 128 px"):
        load_scenes([(str(tmp_path / "small.png"), 1.0)], IMAGERY_ONLY)
    with pytest.raises(TrainingDataError, match="is a folder"):
        load_scenes([(str(tmp_path), 1.0)], IMAGERY_ONLY)


def test_home_and_folders_within_are_understood(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    write_photo(tmp_path / "photos" / "deep" / "a.png", 0)
    write_photo(tmp_path / "photos" / "b.png", 1)
    assert load_scenes([("~/photos/**/*.png", 1.0)], IMAGERY_ONLY).sources[0].images == 2


def test_the_fingerprint_is_of_content_not_of_place(tmp_path: Path) -> None:
    def fingerprint(folder: str, sand_share: float = 0.0, weight: float = 1.0) -> str:
        other = (str(tmp_path / "other.png"), 1.0)
        return load_scenes(
            [(str(tmp_path / folder / "*.png"), weight), other], RenderedShares(sand_share, 0.0)
        ).fingerprint()

    write_photo(tmp_path / "other.png", 9)
    for folder, seed in (("here", 1), ("there", 1), ("changed", 2)):
        write_photo(tmp_path / folder / "a.png", seed)
    assert fingerprint("here") == fingerprint("there")
    different = [fingerprint("here"), fingerprint("changed"), fingerprint("here", 0.2)]
    different.append(fingerprint("here", weight=2.0))
    assert len(set(different)) == 4


def two_dates() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    first, second = (
        np.repeat((pattern(seed, 300, 400) * 255).astype(np.uint8)[..., None], 3, axis=-1)
        for seed in (1, 2)
    )
    return first, second


@pytest.mark.parametrize("length_px", [128, 280])
def test_convention_map_and_night_views_show_the_same_square(
    length_px: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[ImageArray] = []

    def remember(_: np.random.Generator, rgb: ImageArray, __: EngineConfig) -> ImageArray:
        seen.append(rgb)
        return rgb[..., 0]

    monkeypatch.setattr(scenes, "thermal_from_colour", remember)
    dates = two_dates()
    scene = ImageryScene(dates)
    combinations = set()
    for seed in range(30):
        rgb, fields = scene.render(
            np.random.default_rng(seed), 10, 50, length_px, 200, EngineConfig()
        )
        squares = [
            cv2.resize(date[10 : 10 + length_px, 50 : 50 + length_px], (200, 200)) / 255.0
            for date in dates
        ]
        near = [[float(np.abs(s - image).mean()) < 0.01 for s in squares] for image in (rgb, rgb)]
        near[1] = [float(np.abs(s[..., 0] - fields[0]).mean()) < 0.01 for s in squares]
        assert [sum(row) for row in near] == [1, 1]
        combinations.add((near[0].index(True), near[1].index(True)))
        assert np.array_equal(fields[0], fields[1])
    assert combinations == {(0, 0), (0, 1), (1, 0), (1, 1)}, "same and other date both happen"
    assert min(float(image.min()) for image in seen) >= 0
    assert max(float(image.max()) for image in seen) <= 1


def test_without_date_change_map_and_night_view_are_of_one_date(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(scenes, "thermal_from_colour", lambda _, rgb, __: rgb[..., 0])
    scene = ImageryScene(two_dates())
    engine = EngineConfig(date_change=False)
    for seed in range(20):
        rgb, fields = scene.render(np.random.default_rng(seed), 10, 50, 100, 100, engine)
        assert np.array_equal(rgb[..., 0], fields[0])


def test_convention_sand_and_its_night_view_show_the_same_square(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ground = pattern(3, 240, 240)
    sand = SandScene(np.repeat(ground[..., None], 3, axis=-1), ground, ground)
    monkeypatch.setattr(scenes, "_sand", lambda _: sand)
    monkeypatch.setattr(scenes, "thermal_from_sand", lambda _, piece, __: piece.material)
    rgb, fields = RenderedSand(0).render(np.random.default_rng(0), 20, 60, 150, 150, EngineConfig())
    square = ground[20:170, 60:210]
    assert rgb[..., 1] == pytest.approx(square, abs=1e-3)
    assert fields[0] == pytest.approx(square, abs=1e-3)


def test_draw_follows_the_probabilities() -> None:
    found = scenes.SceneSet(
        tuple(RenderedSand(index) for index in range(3)), np.array([0.7, 0.3, 0.0])
    )
    rng = np.random.default_rng(0)
    drawn = [found.draw(rng) for _ in range(500)]
    counts = [sum(scene is kept for scene in drawn) for kept in found.scenes]
    assert counts[2] == 0
    assert 300 < counts[0] < 400
