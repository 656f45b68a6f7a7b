"""From a user's description to a pinhole."""

import logging
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from uasthn_cli.errors import CameraError
from uasthn_cli.ingest.camera_table import find_camera
from uasthn_cli.ingest.cameras import (
    CAMERAS,
    CameraSpec,
    FocalLengthUnknownError,
    FrameSizeError,
    NamedCamera,
)
from uasthn_cli.ingest.exif import ExifFacts, read_exif

NOMINAL_HFOV_DEG = {
    "boson640-4.9mm": 95, "boson640-8.7mm": 50, "boson640-14mm": 32, "boson640-18mm": 24,
    "boson640-24mm": 18, "boson640-36mm": 12, "boson640-55mm": 8, "boson320-2.3mm": 92,
    "boson320-4.3mm": 50, "boson320-6.3mm": 34, "boson320-9.1mm": 24, "boson320-13.8mm": 16,
    "boson320-18mm": 12, "boson320-36mm": 6, "boson320-55mm": 4, "vuepro640-9mm": 69,
    "vuepro640-13mm": 45, "vuepro640-19mm": 32, "vuepro336-6.8mm": 45, "vuepro336-9mm": 35,
    "vuepro336-13mm": 25, "xt2-9mm": 69, "xt2-13mm": 45, "xt2-19mm": 32, "xt2-25mm": 25,
}  # fmt: skip
"""Fields of view that the makers state; wide lenses exceed a pinhole's by their distortion."""


def hfov_deg(spec: CameraSpec, width_px: int, height_px: int) -> float:
    return 2 * math.degrees(math.atan(width_px / 2 / spec.model(width_px, height_px).focal_x_px))


@given(st.floats(5.0, 150.0), st.integers(64, 2000), st.integers(48, 2000))
def test_convention_field_of_view_spans_the_full_width(
    angle_deg: float, width_px: int, height_px: int
) -> None:
    model = CameraSpec(hfov_deg=angle_deg, mount_yaw_deg=90.0).model(width_px, height_px)
    edge = math.degrees(math.atan((width_px / 2) / model.focal_x_px))
    assert 2 * edge == pytest.approx(angle_deg)
    assert (model.principal_x_px, model.principal_y_px) == ((width_px - 1) / 2, (height_px - 1) / 2)
    assert model.focal_x_px == model.focal_y_px
    assert model.mount_yaw_rad == pytest.approx(math.pi / 2)


def test_focal_length_and_pitch() -> None:
    model = CameraSpec(focal_mm=13.0, pixel_pitch_um=17.0, distortion=(0.1, 0, 0, 0)).model(
        640, 512
    )
    assert model.focal_x_px == pytest.approx(764.7, abs=0.1)
    assert model.distortion == (0.1, 0, 0, 0)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_every_row_agrees_with_the_stated_field_of_view(camera: NamedCamera) -> None:
    assert find_camera(camera.name) == camera
    assert len(camera.source) > 20
    found = hfov_deg(CameraSpec(name=camera.name), camera.width_px, camera.height_px)
    stated = NOMINAL_HFOV_DEG.get(camera.name)
    if stated is not None:
        assert found == pytest.approx(stated, rel=0.06 if stated <= 50 else 0.22)


def test_names_forgive_case_spaces_and_hyphens() -> None:
    row = find_camera("Boson 640 14mm")
    assert row is not None
    assert row.name == "boson640-14mm"
    assert len({camera.name for camera in CAMERAS}) == len(CAMERAS)


def test_dji_pitch_and_equivalent_focal_length_agree(shared_dir: Path) -> None:
    for name, camera in (("dji_h20t_rjpeg.jpg", "h20t"), ("dji_m30t_rjpeg.jpg", "m30t")):
        facts = read_exif(shared_dir / "frames" / name)
        with Image.open(shared_dir / "frames" / name) as image:
            size_px = image.size
        by_name = CameraSpec(name=camera).model(*size_px).focal_x_px
        by_pitch = CameraSpec().model(*size_px, facts).focal_x_px
        equivalent = ExifFacts(focal_35mm_mm=facts.focal_35mm_mm)
        assert by_pitch == pytest.approx(by_name)
        assert CameraSpec().model(*size_px, equivalent).focal_x_px == pytest.approx(
            by_name, rel=0.03
        )


def test_exif_of_a_real_xt2(shared_dir: Path) -> None:
    path = shared_dir / "frames" / "xt2_16bit_nadir.tiff"
    model = CameraSpec().model_of_frame(path, 640, 512)
    assert model.focal_x_px == CameraSpec(name="xt2-13mm").model(640, 512).focal_x_px


def test_resampled_frames_keep_the_field_of_view(caplog: pytest.LogCaptureFixture) -> None:
    spec = CameraSpec(name="m3t")
    with caplog.at_level(logging.WARNING):
        assert hfov_deg(spec, 1280, 1024) == pytest.approx(hfov_deg(spec, 640, 512))
    assert "1280 px wide" in caplog.text


def test_frames_of_another_shape_are_refused() -> None:
    with pytest.raises(FrameSizeError, match="640 × 480 px is not the shape of h20t"):
        CameraSpec(name="h20t").model(640, 480)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"name": "hasselblad"}, "no camera is called 'hasselblad'; known: boson640-4.9mm"),
        ({"hfov_deg": 45.0, "name": "h20t"}, "only one"),
        ({"focal_mm": 13.0}, "go together"),
        ({"hfov_deg": 180.0}, "between 0° and 180°"),
        ({"focal_mm": -1.0, "pixel_pitch_um": 12.0}, "above 0"),
        ({"hfov_deg": 45.0, "distortion": (0.1, 0.2)}, "2 distortion coefficients"),
    ],
)
def test_contradictions_are_named(fields: dict[str, object], words: str) -> None:
    with pytest.raises(CameraError, match=words):
        CameraSpec(**fields)  # type: ignore[arg-type]


def test_nothing_known_says_what_to_give() -> None:
    with pytest.raises(CameraError, match="--hfov"):
        CameraSpec().model(640, 512)
    with pytest.raises(FocalLengthUnknownError, match="--camera"):
        CameraSpec().model_of_frame(Path("nowhere.jpg"), 640, 512)
