"""A large map must not cost more memory than a small one."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine

SIDE_PX = 40_000
PROBE = """
import resource, sys
from pathlib import Path
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.mapping.reader import MapReader
from uasthn_cli.types import GridBox

def peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

path, lat, lon, gsd_m = Path(sys.argv[1]), *map(float, sys.argv[2:])
before = peak_mb()
with MapReader(path, LocalFrame(lat, lon), gsd_m) as reader:
    reader.statistics
    assert reader.read(GridBox(-64, -64, 128, 128)).valid.any()
print(peak_mb() - before)
"""


def peak_mb(path: Path, gsd_m: float) -> float:
    """Return what opening, statistics and one window add to a process's memory."""
    place = ["47.9955", "-95.9955", str(gsd_m)]
    run = subprocess.run(
        [sys.executable, "-c", PROBE, str(path), *place], capture_output=True, text=True, check=True
    )
    return float(run.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("gsd_m", [0.5, 5.0])
def test_memory_does_not_grow_with_the_map(tmp_path: Path, gsd_m: float) -> None:
    if sys.platform != "linux":
        pytest.skip("peak memory is counted in other units here")
    step = 2.5e-6
    shape: dict[str, Any] = {"count": 3, "dtype": "uint8", "crs": "EPSG:4326"}
    tiles = {"tiled": True, "blockxsize": 256, "blockysize": 256, "SPARSE_OK": True}
    path = tmp_path / "large.tif"
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=SIDE_PX,
        height=SIDE_PX,
        transform=Affine(step, 0, -96.05, 0, -step, 48.05),
        BIGTIFF="YES",
        **shape,
        **tiles,
    ) as target:
        patch = np.full((3, 256, 256), 90, dtype=np.uint8)
        target.write(patch, window=rasterio.windows.Window(0, 0, 256, 256))
    assert peak_mb(path, gsd_m) < 250
