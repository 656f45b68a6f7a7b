"""Training samples: the same for the same number, and labelled with where canvases truly lie."""

from dataclasses import astuple
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from tiny_training import PatternScene, pattern_scenes
from torch import Tensor, nn

from uasthn_cli.training import samples
from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.losses import search_loss, search_scores
from uasthn_cli.training.samples import CANVAS_PX, WINDOW_PX, Batch, SampleConfig, SampleDataset
from uasthn_cli.types import ImageArray

GREY_LEVELS = 255


def draw(index: int = 0, seed: int = 0, config: SampleConfig | None = None) -> Batch:
    config = config or SampleConfig(windows=2, canvases=3)
    return SampleDataset(pattern_scenes(), config, seed=seed, batches=10)[index]


@pytest.fixture
def undegraded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let canvases show just what lies under them, masked."""
    monkeypatch.setattr(samples, "degrade_thermal", lambda _, thermal, valid, __: thermal * valid)
    monkeypatch.setattr(samples, "degrade_map", lambda _, rgb, __: rgb)


def same(a: Batch, b: Batch) -> bool:
    return all(map(np.array_equal, astuple(a), astuple(b)))


def test_shapes_and_types() -> None:
    batch = draw()
    assert batch.satellite.shape == (2, 3, WINDOW_PX, WINDOW_PX)
    assert batch.satellite_valid.shape == (2, 1, WINDOW_PX, WINDOW_PX)
    assert batch.thermal.shape == batch.thermal_valid.shape == (2, 3, 1, CANVAS_PX, CANVAS_PX)
    assert batch.corners_px.shape == (2, 3, 4, 2)
    assert {array.dtype for array in astuple(batch)} == {np.dtype(np.float32)}
    assert all(np.isfinite(array).all() for array in astuple(batch))


def test_the_same_seed_and_number_give_the_same_batch_in_any_order() -> None:
    dataset = SampleDataset(
        pattern_scenes(), SampleConfig(windows=1, canvases=2), seed=5, batches=10
    )
    first = dataset[3]
    dataset[7]
    assert same(first, dataset[3])
    assert same(first, draw(3, 5, SampleConfig(windows=1, canvases=2)))


def test_other_numbers_and_other_seeds_give_other_batches() -> None:
    batch = draw(3, 5)
    assert not same(batch, draw(4, 5))
    assert not same(batch, draw(3, 6))


def content_under(window: NDArray[np.float32], corners: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return what a window shows under a canvas, by a homography solved for here."""
    last = CANVAS_PX - 1
    equations, values = [], []
    for (x, y), (u, v) in zip([(0, 0), (last, 0), (0, last), (last, last)], corners, strict=True):
        equations += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        values += [u, v]
    h = np.append(np.linalg.solve(np.array(equations, np.float64), np.array(values)), 1)
    H = h.reshape(3, 3)
    y, x = np.mgrid[0:CANVAS_PX, 0:CANVAS_PX]
    u, v, w = np.tensordot(H, np.stack([x, y, np.ones_like(x)]), axes=1)
    seen: NDArray[np.float32] = map_coordinates(window, [v / w, u / w], order=1, cval=np.nan)
    return seen


def mismatch(batch: Batch, shift_px: float = 0.0) -> list[float]:
    """Return by how many grey levels canvases differ from what lies at their stated corners."""
    found = []
    for b, k in np.ndindex(batch.corners_px.shape[:2]):
        expected = content_under(batch.satellite[b, 0], batch.corners_px[b, k] + shift_px)
        compared = (batch.thermal_valid[b, k, 0] > 0) & np.isfinite(expected)
        difference = (batch.thermal[b, k, 0] - expected)[compared]
        found.append(float(np.abs(difference).max()) * GREY_LEVELS)
    return found


@pytest.mark.usefixtures("undegraded")
@pytest.mark.parametrize(
    "errors",
    [
        {"yaw_error_deg": 0.0, "scale_error": 0.0, "corner_error_px": 0.0},
        {"yaw_error_deg": 2.5, "scale_error": 0.04, "corner_error_px": 1.0},
        {"yaw_error_deg": 20.0, "scale_error": 0.2, "corner_error_px": 4.0},
    ],
)
def test_convention_corners_are_where_the_canvas_lies(
    errors: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(samples, "map_edge", lambda _, n: np.ones((n, n), np.float32))
    batch = draw(config=SampleConfig(windows=4, canvases=3, **errors))
    assert max(mismatch(batch)) < 0.5
    assert min(mismatch(batch, shift_px=0.5)) > 0.5, "the pattern is too smooth to tell"


class GreyEncoder(nn.Module):
    """An encoder without weights: the mean grey of each cell."""

    log_temperature = torch.tensor(3.0)

    def encode_satellite(self, rgb: Tensor, *_: Tensor) -> Tensor:
        return nn.functional.avg_pool2d(rgb.mean(dim=1, keepdim=True), 2)

    def encode_thermal(self, thermal: Tensor, _: Tensor) -> Tensor:
        return nn.functional.avg_pool2d(thermal, 2)


@pytest.mark.usefixtures("undegraded")
def test_convention_the_true_shift_is_where_the_search_peaks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(samples, "map_edge", lambda _, n: np.ones((n, n), np.float32))
    exact = SampleConfig(
        windows=6, canvases=6, yaw_error_deg=0.0, scale_error=0.0, corner_error_px=0.0
    )
    batch = draw(config=exact)
    arrays = [torch.from_numpy(array) for array in astuple(batch)]
    scores = search_scores(GreyEncoder(), *arrays[:4])  # type: ignore[arg-type]
    loss, errors_px = search_loss(scores, arrays[4], CANVAS_PX)
    assert float(errors_px.max()) < 1.6, "the best cell is never further than half a cell"
    columns = scores.shape[-1]
    best = scores.flatten(2).argmax(dim=2)
    found = torch.stack([best % columns, best // columns], dim=-1)
    true_cells = (arrays[4].mean(dim=2) - (CANVAS_PX - 1) / 2) / 2
    assert (found - true_cells).mean(dim=(0, 1)).abs().max() < 0.15, "and on neither side of it"
    assert torch.isfinite(loss)


def test_beyond_the_edge_of_the_map_there_is_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    edge = np.ones((WINDOW_PX, WINDOW_PX), np.float32)
    edge[:, 180:] = 0
    monkeypatch.setattr(samples, "map_edge", lambda *_: edge)
    batch = draw(config=SampleConfig(windows=3, canvases=6))
    assert np.array_equal(batch.satellite_valid[:, 0], np.broadcast_to(edge, (3, *edge.shape)))
    assert (batch.satellite[..., 180:] == 0).all()
    assert (batch.satellite[..., :180] > 0).any()
    centres = batch.corners_px.mean(axis=2)
    assert (centres[..., 0] < 182).all(), "every canvas has its centre on the map"


def test_canvases_are_masked_like_rectified_frames() -> None:
    batch = draw(config=SampleConfig(windows=8, canvases=3))
    valid = batch.thermal_valid
    assert set(np.unique(valid)) == {0.0, 1.0}
    assert (batch.thermal[valid == 0] == 0).all()
    share = valid.mean(axis=(2, 3, 4))
    assert share.min() > 0.1
    assert share.max() < 0.8
    assert (valid[..., CANVAS_PX // 2, CANVAS_PX // 2] == 1).all()


def test_canvases_lie_inside_the_window() -> None:
    corners = np.concatenate(
        [draw(index, config=SampleConfig(windows=4, canvases=4)).corners_px for index in range(3)]
    )
    centres = corners.mean(axis=2)
    half = (CANVAS_PX - 1) / 2
    assert centres.min() > half
    assert centres.max() < WINDOW_PX - 1 - half
    assert centres.std() > 20, "all over it"


def test_without_geometry_error_canvases_are_squares() -> None:
    engine = EngineConfig(geometry_error=False)
    corners = draw(config=SampleConfig(windows=3, canvases=3, engine=engine)).corners_px
    square = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * (CANVAS_PX - 1)
    assert corners - corners[:, :, :1] == pytest.approx(np.broadcast_to(square, (3, 3, 4, 2)))


def test_without_a_scale_range_pieces_are_as_long_as_the_window(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lengths_px: list[int] = []

    def remember(
        self: PatternScene, _: np.random.Generator, *where_px: int
    ) -> tuple[ImageArray, list[ImageArray]]:
        lengths_px.append(where_px[2])
        image = np.zeros((WINDOW_PX, WINDOW_PX), np.float32)
        return np.zeros((WINDOW_PX, WINDOW_PX, 3), np.float32), [image, image]

    monkeypatch.setattr(PatternScene, "render", remember)
    draw(config=SampleConfig(windows=8, canvases=1))
    assert len(set(lengths_px)) > 4
    lengths_px.clear()
    draw(config=SampleConfig(windows=8, canvases=1, engine=EngineConfig(scale_range=False)))
    assert set(lengths_px) == {WINDOW_PX}
