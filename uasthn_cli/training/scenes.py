"""Scenes that training samples are cut from: imagery of one or several dates, rendered places."""

import hashlib
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from glob import glob
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from uasthn_cli.errors import TrainingDataError
from uasthn_cli.mapping.imagery import OverheadImage, read_overhead_tiles
from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.fields import resize_square, standardise
from uasthn_cli.training.landscapes import LANDSCAPES, RenderedLandscape
from uasthn_cli.training.places import Places
from uasthn_cli.training.pseudo_thermal import thermal_from_colour
from uasthn_cli.training.sand import SAND_PX, SandScene, render_sand, thermal_from_sand
from uasthn_cli.types import ImageArray

_log = logging.getLogger(__name__)

SAND_SCENES = 100
"""How many stretches of sand a worker renders and keeps."""

_MIN_IMAGE_PX = 128
_CHANGED_DATE_SHARE = 0.6


class Scene(Protocol):
    """A place of which a map and a thermal view can be cut."""

    @property
    def shape_px(self) -> tuple[int, int]:
        """Height and width."""

    def identity(self) -> bytes:
        """Return bytes that differ where another scene is rendered."""

    def render(
        self,
        rng: np.random.Generator,
        row_px: int,
        column_px: int,
        length_px: int,
        size_px: int,
        engine: EngineConfig,
    ) -> tuple[ImageArray, list[ImageArray]]:
        """Return the map ``(size, size, 3)`` in 0..1 and two thermal renderings ``(size, size)``.

        Both show the square of ``length_px`` at ``(row_px, column_px)``.
        """


@dataclass(frozen=True, slots=True)
class ImageryScene:
    """Colour images ``(h, w, 3)`` uint8 of one place, one per date."""

    dates: tuple[NDArray[np.uint8], ...]

    @property
    def shape_px(self) -> tuple[int, int]:
        """Height and width."""
        return self.dates[0].shape[0], self.dates[0].shape[1]

    def identity(self) -> bytes:
        """Return a digest of size and pixels."""
        digest = hashlib.sha256()
        for date in self.dates:
            digest.update(repr(date.shape).encode())
            digest.update(date.tobytes())
        return digest.digest()

    def render(
        self,
        rng: np.random.Generator,
        row_px: int,
        column_px: int,
        length_px: int,
        size_px: int,
        engine: EngineConfig,
    ) -> tuple[ImageArray, list[ImageArray]]:
        """Return a map of one date and thermal renderings of the same or another date."""

        def crop(date: NDArray[np.uint8]) -> ImageArray:
            piece = date[row_px : row_px + length_px, column_px : column_px + length_px]
            return resize_square(piece.astype(np.float32) / 255, size_px)

        map_date, thermal_date = rng.integers(0, len(self.dates), 2)
        if not engine.date_change or rng.random() > _CHANGED_DATE_SHARE:
            thermal_date = map_date
        source = crop(self.dates[thermal_date])
        thermals = [thermal_from_colour(rng, source, engine) for _ in range(2)]
        return crop(self.dates[map_date]), thermals


@dataclass(frozen=True, slots=True)
class RenderedSand:
    """Sand number ``index``, rendered when first needed."""

    index: int

    @property
    def shape_px(self) -> tuple[int, int]:
        """Height and width."""
        return SAND_PX, SAND_PX

    def identity(self) -> bytes:
        """Return which sand this is."""
        return f"sand {self.index}".encode()

    def render(
        self,
        rng: np.random.Generator,
        row_px: int,
        column_px: int,
        length_px: int,
        size_px: int,
        engine: EngineConfig,
    ) -> tuple[ImageArray, list[ImageArray]]:
        """Return the sunlit map and two night views of the same relief."""
        whole = _sand(self.index)
        rows, columns = slice(row_px, row_px + length_px), slice(column_px, column_px + length_px)
        piece = SandScene(
            resize_square(whole.rgb[rows, columns].astype(np.float32), size_px),
            standardise(resize_square(whole.height[rows, columns].astype(np.float32), size_px)),
            resize_square(whole.material[rows, columns].astype(np.float32), size_px),
        )
        return piece.rgb, [thermal_from_sand(rng, piece, engine) for _ in range(2)]


@dataclass(frozen=True, slots=True)
class RenderedShares:
    """Shares of the windows that show rendered sand and landscapes; the rest shows imagery."""

    sand: float
    landscapes: float

    @property
    def imagery(self) -> float:
        """What is left for imagery."""
        return max(0.0, 1.0 - self.sand - self.landscapes)


@dataclass(frozen=True, slots=True)
class ImageSource:
    """A glob pattern, its weight, and how many image files it gave."""

    pattern: str
    weight: float
    images: int


@dataclass(frozen=True, slots=True)
class SceneSet:
    """Scenes, the probability of drawing each, and where the imagery among them comes from."""

    scenes: tuple[Scene, ...]
    probabilities: NDArray[np.float64]
    sources: tuple[ImageSource, ...] = ()

    def draw(self, rng: np.random.Generator) -> Scene:
        """Return a random scene."""
        return self.scenes[int(rng.choice(len(self.scenes), p=self.probabilities))]

    def fingerprint(self) -> str:
        """Return a digest of everything that is drawn, wherever the files lie."""
        digest = hashlib.sha256(self.probabilities.tobytes())
        for scene in self.scenes:
            digest.update(scene.identity())
        return digest.hexdigest()


def load_scenes(patterns: Sequence[tuple[str, float]], rendered: RenderedShares) -> SceneSet:
    """Read imagery by glob pattern and weight, and add rendered places.

    Within a pattern an image counts by its area (up to nine times 400 × 400 px). GeoTIFFs whose
    grids agree to half a pixel become one scene of several dates. All imagery is kept in memory.

    Raises:
        TrainingDataError: a pattern yields no usable image, or there is nothing to train on.
    """
    scenes: list[Scene] = []
    weights: list[float] = []
    sources: list[ImageSource] = []
    for pattern, weight in patterns:
        found, images = _read_pattern(pattern)
        if not found:
            raise TrainingDataError(_nothing_found(pattern))
        areas = [min(9.0, s.shape_px[0] * s.shape_px[1] / 160_000) for s in found]
        scenes += found
        weights += [weight * area / sum(areas) for area in areas]
        sources.append(ImageSource(pattern, weight, images))
        _log.info("%s: %d images, %d scenes", pattern, images, len(found))
    total = sum(weights) or 1.0
    weights = [rendered.imagery * w / total for w in weights]
    if rendered.sand > 0:
        scenes += [RenderedSand(index) for index in range(SAND_SCENES)]
        weights += [rendered.sand / SAND_SCENES] * SAND_SCENES
    if rendered.landscapes > 0:
        scenes += [RenderedLandscape(index) for index in range(LANDSCAPES)]
        weights += [rendered.landscapes / LANDSCAPES] * LANDSCAPES
    if not scenes:
        raise TrainingDataError("nothing to train on: give --images, or shares of rendered places")
    probabilities = np.asarray(weights)
    return SceneSet(tuple(scenes), probabilities / probabilities.sum(), tuple(sources))


def _nothing_found(pattern: str) -> str:
    """Return what to say of a pattern that gives no image."""
    if Path(pattern).expanduser().is_dir():
        return f"{pattern} is a folder; name the images in it, say --images '{pattern}/*.tif'"
    return f"no readable image of at least {_MIN_IMAGE_PX} px matches {pattern!r}; check --images"


def _read_pattern(pattern: str) -> tuple[list[Scene], int]:
    """Return the scenes of one glob pattern, and of how many files they are made."""
    places = Places()
    images = 0
    names = glob(str(Path(pattern).expanduser()), recursive=True)  # noqa: PTH207 (may be absolute)
    for name in sorted(names):
        usable = False
        for image in read_overhead_tiles(Path(name)):
            if min(image.rgb.shape[:2]) >= _MIN_IMAGE_PX:
                places.add(image)
                usable = True
        images += usable
    return [_as_scene(dates) for dates in places], images


def _as_scene(images: list[OverheadImage]) -> Scene:
    height = min(image.rgb.shape[0] for image in images)
    width = min(image.rgb.shape[1] for image in images)
    return ImageryScene(tuple(image.rgb[:height, :width] for image in images))


@lru_cache(maxsize=SAND_SCENES)
def _sand(index: int) -> SandScene:
    scene = render_sand(np.random.default_rng([11, index]))
    return SandScene(
        scene.rgb.astype(np.float16),  # half the memory in every worker
        scene.height.astype(np.float16),
        scene.material.astype(np.float16),
    )
