"""Listing frames and reading their pixels, whole and damaged."""

import warnings
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from uasthn_cli.errors import FramesError
from uasthn_cli.ingest.frames import (
    UnreadableFrameError,
    frame_size_px,
    list_frames,
    read_frame,
)

WIDTH_PX, HEIGHT_PX = 40, 24


Pixels = NDArray[np.integer[Any] | np.floating[Any]]


def gradient(
    dtype: type[np.uint8 | np.uint16 | np.float32], top: float, channels: int = 1
) -> Pixels:
    """Return an image that rises from left to right, the same in each channel."""
    row = np.linspace(0.0, top, WIDTH_PX)
    image: Pixels = np.repeat(np.tile(row, (HEIGHT_PX, 1))[..., None], channels, axis=2).astype(
        dtype
    )
    return image[..., 0] if channels == 1 else image


@pytest.mark.parametrize("suffix", [".png", ".tif", ".jpg"])
@pytest.mark.parametrize("channels", [1, 3])
def test_convention_rows_columns_and_8_bit_values(
    tmp_path: Path, suffix: str, channels: int
) -> None:
    path = tmp_path / f"frame{suffix}"
    cv2.imwrite(str(path), gradient(np.uint8, 255.0, channels))
    image = read_frame(path)
    assert image.shape == (HEIGHT_PX, WIDTH_PX)
    assert image.dtype == np.float32
    np.testing.assert_allclose(image[5], np.linspace(0.0, 1.0, WIDTH_PX), atol=0.02)
    assert frame_size_px(path) == (WIDTH_PX, HEIGHT_PX)


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
@pytest.mark.parametrize("channels", [1, 3])
def test_16_bit_counts_are_stretched(tmp_path: Path, suffix: str, channels: int) -> None:
    path = tmp_path / f"frame{suffix}"
    cv2.imwrite(str(path), 21_000 + gradient(np.uint16, 300.0, channels))
    image = read_frame(path)
    np.testing.assert_allclose(image[5], np.linspace(0.0, 1.0, WIDTH_PX), atol=0.03)


def test_a_hot_spot_does_not_darken_the_rest(tmp_path: Path) -> None:
    counts = 7000 + gradient(np.uint16, 100.0)
    counts[0, 0] = 65_535
    cv2.imwrite(str(tmp_path / "hot.png"), counts)
    assert read_frame(tmp_path / "hot.png")[5].max() > 0.95


def test_degrees_in_floating_point_with_holes(tmp_path: Path) -> None:
    degrees = gradient(np.float32, 30.0).astype(np.float32)
    degrees[3, 3] = np.nan
    Image.fromarray(degrees).save(tmp_path / "celsius.tif")
    image = read_frame(tmp_path / "celsius.tif")
    assert np.isfinite(image).all()
    np.testing.assert_allclose(image[5], np.linspace(0.0, 1.0, WIDTH_PX), atol=0.03)


def test_colours_are_weighed_in_the_right_order(tmp_path: Path) -> None:
    for depth, top in ((np.uint8, 255), (np.uint16, 65_535)):
        rgb = np.zeros((HEIGHT_PX, WIDTH_PX, 3), dtype=depth)
        rgb[:, : WIDTH_PX // 2, 0] = top
        rgb[:, WIDTH_PX // 2 :, 2] = top
        cv2.imwrite(str(tmp_path / "rgb.png"), rgb[..., ::-1])
        image = read_frame(tmp_path / "rgb.png")
        assert image[0, 0] > image[0, -1] + 0.1


@pytest.mark.parametrize("mode", ["RGBA", "LA", "P", "1"])
def test_alpha_palette_and_two_values(tmp_path: Path, mode: str) -> None:
    Image.fromarray(gradient(np.uint8, 255.0)).convert(mode).save(tmp_path / "frame.png")
    image = read_frame(tmp_path / "frame.png")
    assert image.shape == (HEIGHT_PX, WIDTH_PX)
    assert image[:, -8:].mean() > image[:, :8].mean() + 0.5


def test_convention_exif_orientation_leaves_sensor_rows_alone(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    path = tmp_path / "turned.jpg"
    Image.fromarray(gradient(np.uint8, 255.0)).save(path, exif=exif)
    assert read_frame(path).shape == (HEIGHT_PX, WIDTH_PX)
    assert frame_size_px(path) == (WIDTH_PX, HEIGHT_PX)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty file"),
        (b"this is a text\n", "not a PNG, JPEG or TIFF"),
        (b"\x89PNG\r\n\x1a\n", "not a PNG|damaged"),
    ],
)
def test_what_is_no_image_says_so(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "frame.png"
    path.write_bytes(content)
    for read in (read_frame, frame_size_px):
        with pytest.raises(UnreadableFrameError, match=words):
            read(path)


def test_other_formats_and_missing_files_are_refused(tmp_path: Path) -> None:
    Image.fromarray(gradient(np.uint8, 255.0)).save(tmp_path / "frame.gif")
    (tmp_path / "frame.gif").rename(tmp_path / "frame.png")
    with pytest.raises(UnreadableFrameError, match="GIF image"):
        read_frame(tmp_path / "frame.png")
    with pytest.raises(UnreadableFrameError, match="No such file"):
        read_frame(tmp_path / "gone.png")


@given(suffix=st.sampled_from([".png", ".jpg", ".tif"]), deep=st.booleans(), data=st.data())
@settings(max_examples=100, deadline=None)
def test_truncation_is_noticed_or_harmless(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, deep: bool, data: st.DataObject
) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (HEIGHT_PX, WIDTH_PX))
    pixels: Pixels = noise.astype(np.uint16 if deep and suffix != ".jpg" else np.uint8)
    _, encoded = cv2.imencode(suffix, pixels)
    content = encoded.tobytes()
    path = tmp_path_factory.getbasetemp() / f"cut{suffix}"
    path.write_bytes(content)
    whole = read_frame(path)
    path.write_bytes(content[: data.draw(st.integers(0, len(content) - 1))])
    try:
        image = read_frame(path)
    except UnreadableFrameError as error:
        assert "\n" not in str(error)
    else:
        np.testing.assert_array_equal(image, whole)


@given(data=st.data(), suffix=st.sampled_from([".png", ".jpg", ".tif"]))
@settings(max_examples=150, deadline=None)
def test_corruption_raises_nothing_else(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, data: st.DataObject
) -> None:
    _, encoded = cv2.imencode(suffix, gradient(np.uint8, 255.0))
    content = bytearray(encoded.tobytes())
    place = st.integers(0, len(content) - 1)
    for where, value in data.draw(st.lists(st.tuples(place, st.integers(0, 255)), max_size=8)):
        content[where] = value
    path = tmp_path_factory.getbasetemp() / f"corrupt{suffix}"
    path.write_bytes(bytes(content))
    for read in (read_frame, frame_size_px):
        try:
            read(path)
        except UnreadableFrameError as error:
            assert "\n" not in str(error)


def test_reading_leaves_the_filters_of_warnings_alone(tmp_path: Path) -> None:
    whole, empty = tmp_path / "whole.png", tmp_path / "empty.png"
    cv2.imwrite(str(whole), gradient(np.uint8, 255.0))
    empty.touch()
    before = list(warnings.filters)
    read_frame(whole)
    with pytest.raises(UnreadableFrameError):
        read_frame(empty)
    assert list(warnings.filters) == before


def test_frames_come_in_natural_order_from_all_folders(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    for name in ("f10.png", "f9.PNG", "f100.Jpg", "b/f1.TIFF", ".hidden.png", "notes.txt"):
        (tmp_path / name).touch()
    names = [frame.name for frame in list_frames(tmp_path)]
    assert names == ["b/f1.TIFF", "f9.PNG", "f10.png", "f100.Jpg"]


def test_folders_without_frames_say_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(FramesError, match="does not exist"):
        list_frames(tmp_path / "nowhere")
    with pytest.raises(FramesError, match="it is empty"):
        list_frames(tmp_path)
    (tmp_path / "a.bmp").touch()
    (tmp_path / "b.bmp").touch()
    with pytest.raises(FramesError, match=r"2 files seen: 2 \.bmp"):
        list_frames(tmp_path)
    with pytest.raises(FramesError, match="is a file"):
        list_frames(tmp_path / "a.bmp")


def test_real_thermal_frames_are_read(shared_dir: Path) -> None:
    frames = list_frames(shared_dir / "frames")
    assert len(frames) == 14
    for frame in frames:
        image = read_frame(frame.path)
        expected = (1280, 1024) if "m30t" in frame.name else (640, 512)
        assert frame_size_px(frame.path) == expected == image.shape[::-1]
        assert image.min() >= 0.0
        assert image.max() <= 1.0
        assert image.std() > 0.02


def test_a_real_radiometric_tiff_uses_the_whole_range(shared_dir: Path) -> None:
    image = read_frame(shared_dir / "frames" / "xt2_16bit_nadir.tiff")
    assert (image.min(), image.max()) == (0.0, 1.0)
    assert 0.2 < float(np.median(image)) < 0.8
