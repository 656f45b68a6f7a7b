"""Speed by stage adds up to the whole, in the unit of NCC's search."""

import pytest
from speed import STAGES, Measurement, as_markdown


def test_stages_are_counted_in_searches_of_ncc() -> None:
    stages = {"search": 2.0, "all": 4.0}
    runs = {
        "xcorr --fuse": Measurement(10, stages | {"search": 6.0, "fuse": 1.0, "all": 8.0}, 512.0),
        "ncc --no-fuse": Measurement(10, stages, None),
    }
    lines = as_markdown("**flight**", runs, threads=3).splitlines()
    cells = {line.split("|")[1].strip(): line.split("|")[2:-1] for line in lines if "|" in line}
    assert set(STAGES) < set(cells)
    assert [float(cell) for cell in cells["search"]] == pytest.approx([600.0, 3.0, 200.0, 1.0])
    assert [float(cell) for cell in cells["fuse"]] == pytest.approx([100.0, 0.5, 0.0, 0.0])
    assert [float(cell) for cell in cells["decode"]] == [0.0] * 4
    assert "- xcorr --fuse: 1.25 frames/s, peak memory 512 MiB" in lines
    assert "- ncc --no-fuse: 2.50 frames/s, peak memory – MiB" in lines
    assert "3 threads" in lines[-1]
