"""The example of an estimator of one's own, installed as a user would install it."""

import csv
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plugin_packages import EXAMPLE
from small_flight import HFOV_DEG, Flight, make_flight

NAME = "gradient-ncc"
REPOSITORY = Path(__file__).parents[2]

SAME_WINDOW = """
import sys
from pathlib import Path
import numpy as np
from uasthn_cli.config import GeotagConfig
from uasthn_cli.evaluation.members import open_members
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.pipeline import GeotagJob
from uasthn_cli.pipeline.estimators import open_base
from matching_scene import centred_origin, encoded, full_view, map_window, thermal_cut
from small_flight import ground_texture

nowhere = Path("none")
job = GeotagJob(nowhere, nowhere, nowhere, CameraSpec(), config=GeotagConfig("gradient-ncc"))
(member,) = open_members("gradient-ncc", [], device="cpu", symmetries=1, ensemble=False)
grey = ground_texture(3)
window, thermal = map_window(grey), thermal_cut(255.0 - grey, (120, 90), (160, 128))
views, origin = full_view(thermal), centred_origin(window, thermal)
found = [
    one.estimate(encoded(one, window), thermal, views, origin).corners_px
    for one in (open_base(job), member)
]
assert np.array_equal(*found)
assert np.abs(found[0] - views - (120, 90)).max() < 1.0, found[0] - views
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return variables under which the package is installed beside this repository's code."""
    site = tmp_path_factory.mktemp("site")
    source = site / "source"
    shutil.copytree(EXAMPLE, source)  # building leaves files beside the source
    install = ["-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--target"]
    command = [sys.executable, *install, str(site), str(source)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    if ran.returncode:
        pytest.skip(f"pip cannot install here: {ran.stderr.strip().splitlines()[-1:]}")
    path = os.pathsep.join(map(str, (site, REPOSITORY, REPOSITORY / "tests" / "support")))
    return {**os.environ, "PYTHONPATH": path}


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return make_flight(tmp_path_factory.mktemp("flight") / "flight", count=2)


def uasthn(environment: dict[str, str], *arguments: object) -> str:
    command = [sys.executable, "-m", "uasthn_cli", *map(str, arguments)]
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


@pytest.mark.slow
def test_geotag_and_evaluate_take_it_by_name(
    environment: dict[str, str], flight: Flight, tmp_path: Path
) -> None:
    out, table = tmp_path / "out", tmp_path / "table"
    asked = ("--estimator", NAME, "--hfov", HFOV_DEG)
    inputs = (flight.log, flight.frames, "--map", flight.map, "--truth", flight.truth)
    uasthn(environment, "geotag", *inputs, *asked, "--search-radius", 40, "--out", out)
    with (out / "frames.csv").open(newline="") as handle:
        errors_m = [float(row["ce_m"]) for row in csv.DictReader(handle)]
    options = ("--dc", 15, "--views", 2, "--no-figures", "--out", table)
    uasthn(environment, "evaluate", flight.map.parent, *asked, *options)
    with (table / "accuracy.csv").open(newline="") as handle:
        errors_m += [float(row["mace_all_m"]) for row in csv.DictReader(handle)]
    assert max(errors_m) < 5.0
    assert NAME in uasthn(environment, "geotag", "--help")


@pytest.mark.slow
def test_both_score_the_same_frame_the_same(environment: dict[str, str]) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", SAME_WINDOW],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr


def test_the_example_is_short() -> None:
    code = (EXAMPLE / "uasthn_gradient_ncc.py").read_text("utf-8").splitlines()
    assert len(code) < 60
    assert np.mean([len(line) for line in code]) < 80
