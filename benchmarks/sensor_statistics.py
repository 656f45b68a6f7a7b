"""What thermal sensors do to a scene, measured on real frames and on what training renders.

    python benchmarks/sensor_statistics.py --shared ../shared

Images are reduced to the width at which the network sees a frame and standardised, so figures are
shares of a frame's own contrast; only clipping is counted before. A scene has fine and coarse
structure of its own: the rendered samples without the sensor say how much a measure takes for the
sensor's.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import click
import cv2
import numpy as np
from tables import markdown_table, number, use_threads

from uasthn_cli.config import THERMAL_WIDTH_PX
from uasthn_cli.ingest.frames import read_frame
from uasthn_cli.training.degrade import degrade_thermal
from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.fields import standardise
from uasthn_cli.training.samples import WINDOW_PX
from uasthn_cli.training.scenes import RenderedShares, SceneSet, load_scenes
from uasthn_cli.types import ImageArray

_NOISE_KERNEL = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6
"""Two second derivatives at right angles: blind to edges (Immerkær 1996); unit gain for noise."""

_BLOCK_PX = 8
_QUIET_SHARE = 0.25
_MAD_TO_DEVIATION = 1.4826
_HEIGHT_PX = 77
_SLOPE_BAND = (0.06, 0.4)
_PERCENT = (5, 50, 95)

REAL: Final = {
    "XT2, 16 bit": "frames/xt2_*.tiff",
    "HIT-UAV": "frames/hituav_*.jpg",
    "DJI R-JPEG": "frames/dji_*.jpg",
    "farms_bing": "flights/farms_bing/frames/*.png",
    "dunes_east": "flights/dunes_east/frames/*.png",
}


def noise_share(image: ImageArray) -> float:
    """Return the deviation of the noise: that of the quietest quarter of the image."""
    response = np.abs(cv2.filter2D(image, cv2.CV_32F, _NOISE_KERNEL)[1:-1, 1:-1])
    rows, columns = (n // _BLOCK_PX for n in response.shape)
    blocks = response[: rows * _BLOCK_PX, : columns * _BLOCK_PX]
    blocks = blocks.reshape(rows, _BLOCK_PX, columns, _BLOCK_PX).swapaxes(1, 2)
    medians = np.median(blocks.reshape(rows * columns, -1), axis=1)
    return _MAD_TO_DEVIATION * float(np.quantile(medians, _QUIET_SHARE))


def stripe_share(image: ImageArray) -> float:
    """Return the deviation of what whole columns have in common and their neighbours have not."""
    smooth = cv2.GaussianBlur(image, (0, 0), sigmaX=1.5, sigmaY=1e-3)
    rest = np.clip(image - smooth, *np.quantile(image - smooth, (0.1, 0.9)))
    by_chance = float(rest.var()) / image.shape[0]
    return float(np.sqrt(max(0.0, float(rest.mean(axis=0).var()) - by_chance)))


def drift_share(image: ImageArray) -> float:
    """Return the deviation of the quadratic surface that fits an image best."""
    rows, columns = np.mgrid[-1 : 1 : image.shape[0] * 1j, -1 : 1 : image.shape[1] * 1j]
    x, y = columns.ravel(), rows.ravel()
    terms = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    surface = terms @ np.linalg.lstsq(terms, image.ravel(), rcond=None)[0]
    return float(surface.std())


def spectral_slope(image: ImageArray) -> float:
    """Return the exponent of power over frequency: the more negative, the more blurred."""
    window = np.outer(np.hanning(image.shape[0]), np.hanning(image.shape[1]))
    power = np.abs(np.fft.rfft2((image - image.mean()) * window)) ** 2
    frequency = np.hypot(
        np.fft.fftfreq(image.shape[0])[:, None], np.fft.rfftfreq(image.shape[1])[None]
    )
    edges = np.geomspace(*_SLOPE_BAND, 9)
    band = np.digitize(frequency, edges)
    means = [float(np.log(power[band == n].mean())) for n in range(1, len(edges))]
    return float(np.polyfit(np.log(np.sqrt(edges[1:] * edges[:-1])), means, 1)[0])


def clipped_share(image: ImageArray) -> float:
    """Return the share of pixels that have the lowest or the highest value."""
    return float(np.mean((image == image.min()) | (image == image.max())))


MEASURES: Final[dict[str, Callable[[ImageArray], float]]] = {
    "noise": noise_share,
    "column stripes": stripe_share,
    "row stripes": lambda image: stripe_share(np.ascontiguousarray(image.T)),
    "drift": drift_share,
    "spectral slope": spectral_slope,
    "clipped": clipped_share,
}


def measure(image: ImageArray) -> list[float]:
    """Return every measure of a frame: clipping at its own size, the others at the network's."""
    height_px = round(image.shape[0] * THERMAL_WIDTH_PX / image.shape[1])
    small = cv2.resize(image, (THERMAL_WIDTH_PX, height_px), interpolation=cv2.INTER_AREA)
    seen = standardise(small)
    return [take(image if take is clipped_share else seen) for take in MEASURES.values()]


def real_frames(pattern: Path) -> Iterator[ImageArray]:
    """Yield frames in the order of their names."""
    for path in sorted(pattern.parent.glob(pattern.name)):
        yield read_frame(path)


def rendered_frames(scenes: SceneSet, engine: EngineConfig, count: int) -> Iterator[ImageArray]:
    """Yield the middles of rendered windows as a sensor sees them."""
    row_px, column_px = (WINDOW_PX - _HEIGHT_PX) // 2, (WINDOW_PX - THERMAL_WIDTH_PX) // 2
    valid = np.ones((_HEIGHT_PX, THERMAL_WIDTH_PX), np.float32)
    for index in range(count):
        rng = np.random.default_rng([4242, index])
        scene = scenes.draw(rng)
        length_px = min(*scene.shape_px, 2 * WINDOW_PX)
        _, (field, _) = scene.render(rng, 0, 0, length_px, WINDOW_PX, engine)
        piece = field[row_px : row_px + _HEIGHT_PX, column_px : column_px + THERMAL_WIDTH_PX]
        yield degrade_thermal(rng, piece.copy(), valid, engine)


def table(sources: dict[str, list[ImageArray]]) -> str:
    """Return a Markdown table of 5th, 50th and 95th percentiles."""
    rows = []
    for name, images in sources.items():
        percentiles = np.percentile([measure(image) for image in images], _PERCENT, axis=0).T
        cells = [" ".join(number(value, 3) for value in row) for row in percentiles]
        rows.append([name, str(len(images)), *cells])
    return markdown_table(("frames", "count", *MEASURES), rows)


@click.command()
@click.option(
    "--shared",
    type=click.Path(path_type=Path),
    default=Path(__file__).resolve().parents[2] / "shared",
    show_default=True,
)
@click.option("--count", type=int, default=150, show_default=True, help="Rendered frames.")
def main(shared: Path, count: int) -> None:
    """Measure and print."""
    use_threads(1)
    sources = {name: list(real_frames(shared / pattern)) for name, pattern in REAL.items()}
    imagery = [(str(shared / "imagery" / "naip" / "*.tif"), 1.0)]
    scenes = load_scenes(imagery, RenderedShares(0.25, 0.45))
    for name, engine in {
        "rendered, with sensor": EngineConfig(),
        "rendered, without": EngineConfig(sensor=False),
    }.items():
        sources[name] = list(rendered_frames(scenes, engine, count))
    click.echo(
        "5th, 50th and 95th percentile, in deviations of the frame but for slope and share\n"
    )
    click.echo(table(sources))


if __name__ == "__main__":
    main()
