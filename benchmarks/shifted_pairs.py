r"""One pair of images as many: windows cut from its satellite image, off by up to D_C.

    python benchmarks/shifted_pairs.py SATELLITE.png THERMAL.png \
        --satellite-gsd 4.18 --thermal-gsd 1.40 --out DIR

Both images must have the same middle. Windows are as wide as the satellite image leaves room for;
DIR is a table of pairs for `uasthn evaluate`, whose `--samples` and `--dc` then need not be given.
"""

from pathlib import Path

import click
import cv2
import numpy as np
import pandas as pd

from uasthn_cli.outputs.atomic import write_bytes, write_text


def offsets_px(count: int, farthest_px: float, seed: int) -> np.ndarray:
    """Return offsets ``(count, 2)`` spread evenly over a disc."""
    rng = np.random.default_rng(seed)
    angle_rad = rng.uniform(0.0, 2.0 * np.pi, count)
    distance_px = farthest_px * np.sqrt(rng.uniform(0.0, 1.0, count))
    return np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1) * distance_px[:, None]


@click.command()
@click.argument("satellite_path", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("thermal_path", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--satellite-gsd", "satellite_gsd_m", type=float, required=True)
@click.option("--thermal-gsd", "thermal_gsd_m", type=float, required=True)
@click.option("--dc", "farthest_m", type=float, default=256.0, show_default=True)
@click.option("--count", type=click.IntRange(min=1), default=16, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), required=True)
def main(
    satellite_path: Path,
    thermal_path: Path,
    satellite_gsd_m: float,
    thermal_gsd_m: float,
    farthest_m: float,
    count: int,
    seed: int,
    out: Path,
) -> None:
    """Cut windows from a pair's satellite image."""
    satellite = cv2.imread(str(satellite_path), cv2.IMREAD_COLOR)
    if satellite is None:
        raise click.ClickException(f"{satellite_path}: not a readable image")
    side_px = min(satellite.shape[:2])
    farthest_px = farthest_m / satellite_gsd_m
    width_px = int(side_px - 2 * np.ceil(farthest_px))
    if width_px < thermal_gsd_m / satellite_gsd_m * side_px / 4:
        raise click.UsageError(f"--dc {farthest_m:g} leaves windows of {width_px} px")
    out.mkdir(parents=True, exist_ok=True)
    middle_px = 0.5 * (np.array([satellite.shape[1], satellite.shape[0]]) - 1.0)
    rows = []
    for number, offset_px in enumerate(offsets_px(count, farthest_px, seed)):
        first = np.round(middle_px + offset_px - 0.5 * (width_px - 1)).astype(int)
        window = satellite[first[1] : first[1] + width_px, first[0] : first[0] + width_px]
        name = f"{number:03d}"
        write_bytes(out / f"{name}.png", cv2.imencode(".png", window)[1].tobytes())
        x, y = middle_px - first
        rows.append((name, f"{name}.png", thermal_path.resolve(), satellite_gsd_m, x, y))
    columns = ["name", "satellite", "thermal", "satellite_gsd_m", "center_x", "center_y"]
    table = pd.DataFrame(rows, columns=columns).assign(thermal_gsd_m=thermal_gsd_m)
    write_text(out / "pairs.csv", table.to_csv(index=False))
    click.echo(f"{count} windows of {width_px} px, up to {farthest_m:g} m off, in {out}")


if __name__ == "__main__":
    main()
