"""``uasthn cameras``: the cameras that ``--camera`` knows."""

import json
import math

import click


@click.command(short_help="List the cameras that --camera knows.")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list.")
def cameras(as_json: bool) -> None:
    """List the thermal cameras that --camera knows, and where each number comes from."""
    from uasthn_cli.ingest.cameras import CAMERAS

    rows = [
        {
            "name": camera.name,
            "width_px": camera.width_px,
            "height_px": camera.height_px,
            "pixel_pitch_um": camera.pixel_pitch_um,
            "focal_mm": camera.focal_mm,
            "hfov_deg": round(
                _hfov_deg(camera.width_px, camera.pixel_pitch_um, camera.focal_mm), 1
            ),
            "source": camera.source,
        }
        for camera in CAMERAS
    ]
    if as_json:
        click.echo(json.dumps(rows, indent=2, ensure_ascii=False))
        return
    click.echo(f"{'name':<18}{'pixels':<12}{'pitch':<9}{'lens':<10}{'view':<8}source")
    for row in rows:
        size = f"{row['width_px']} × {row['height_px']}"
        pitch, lens = f"{row['pixel_pitch_um']:g} µm", f"{row['focal_mm']:g} mm"
        click.echo(
            f"{row['name']:<18}{size:<12}{pitch:<9}{lens:<10}{row['hfov_deg']:<8}{row['source']}"
        )


def _hfov_deg(width_px: int, pixel_pitch_um: float, focal_mm: float) -> float:
    """Return the horizontal field of view of an undistorted lens."""
    return math.degrees(2.0 * math.atan(width_px * pixel_pitch_um * 1e-3 / (2.0 * focal_mm)))
