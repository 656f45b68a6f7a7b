from pathlib import Path

import pytest
from known_estimator import SETTINGS, ShiftEstimator
from small_flight import HFOV_DEG, make_flight

from uasthn_cli.config import CropTtaConfig, DecisionConfig, UeMethod
from uasthn_cli.datasets.spec import DatasetSpec
from uasthn_cli.evaluation.judging import JudgingConfig
from uasthn_cli.evaluation.protocol import ProtocolConfig
from uasthn_cli.evaluation.stress import CATEGORIES, HEALTHY, StressSuite
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.synth.kinds import StressCategory
from uasthn_cli.types import FloatArray


def scatter(found_px: FloatArray) -> None:
    """Let crops disagree."""
    found_px[1:] += 60.0


def suite(estimator: ShiftEstimator, samples: int | None = None) -> StressSuite:
    return StressSuite(
        [estimator],
        SETTINGS,
        ProtocolConfig(CropTtaConfig()),
        DatasetSpec(max_offset_m=10.0, camera=CameraSpec(hfov_deg=HFOV_DEG), samples=samples),
        UeMethod.CROPTTA,
        JudgingConfig(DecisionConfig(max_std_m=10.0)),
    )


def test_a_row_for_the_healthy_flight_and_every_category_and_severity(tmp_path: Path) -> None:
    folder = make_flight(tmp_path / "flight", 2).map.parent
    chosen = (StressCategory.TEXTURELESS, StressCategory.EXPOSURE)
    rows = list(suite(ShiftEstimator()).rows([folder], chosen, (0.5, 1.0)))
    assert [(row.category, row.severity) for row in rows] == [
        (HEALTHY, 0.0),
        *((category, severity) for category in chosen for severity in (0.5, 1.0)),
    ]
    assert {row.frames for row in rows} == {2}
    # views of this estimator always agree, and its prior lies within 10 m
    assert all(row.rejected_fraction == 0.0 for row in rows)
    assert all(row.accepted_within == 1.0 for row in rows)
    refused = list(suite(ShiftEstimator(spoil=scatter)).rows([folder], chosen, (1.0,)))
    assert all(row.rejected_fraction == 1.0 for row in refused)
    assert all(row.accepted_within is None for row in refused)


def test_only_frames_beyond_the_map_count_where_it_is_cut(tmp_path: Path) -> None:
    folder = make_flight(tmp_path / "flight", 4).map.parent
    cut = StressCategory.BEYOND_MAP
    rows = {row.severity: row for row in suite(ShiftEstimator()).rows([folder], (cut,), (0.1, 1.0))}
    assert rows[0.0].frames == 4
    assert rows[0.1].frames < rows[1.0].frames <= 4


def test_the_six_cases_of_the_paper_are_the_default() -> None:
    assert len(CATEGORIES) == 6
    assert StressCategory.WRONG_PLACE not in CATEGORIES


@pytest.mark.parametrize("samples", [1, 3])
def test_fewer_frames_can_be_looked_at(tmp_path: Path, samples: int) -> None:
    folder = make_flight(tmp_path / "flight", 4).map.parent
    (row,) = suite(ShiftEstimator(), samples=samples).rows([folder], (), ())
    assert row.frames == samples
    assert row.rejected_fraction == 0.0
