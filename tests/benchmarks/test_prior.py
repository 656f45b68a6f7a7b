"""The log alone: nothing is searched."""

from pathlib import Path

import pytest
from posed_flight import POSES, alone, make_posed_flight, opened
from prior import PriorEstimator

from uasthn_cli.types import Fix


def test_the_prior_stays_where_it_is(tmp_path: Path) -> None:
    flight = make_posed_flight(tmp_path / "posed", POSES[:2])
    with opened(flight, PriorEstimator(), gsd_m=1.0) as run:
        for result in alone(run):
            assert isinstance(result, Fix)
            assert result.offset_m == pytest.approx(0.0, abs=1e-3)
