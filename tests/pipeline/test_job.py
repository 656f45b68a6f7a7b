"""Which method tells the uncertainty of a run's answers, and what contradicts itself."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from plugin_packages import pretend_installed

from uasthn_cli.config import (
    BUNDLED_CALIBRATION,
    Aggregation,
    CropTtaConfig,
    DecisionConfig,
    GeotagConfig,
    Merge,
    UeMethod,
)
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.pipeline import GeotagJob, open_run
from uasthn_cli.pipeline.job import chosen_calibration, chosen_uncertainty, settled_jobs
from uasthn_cli.uncertainty.calibration import AnswerKind, load_calibration
from uasthn_cli.uncertainty.methods import UncertaintyChoice

WHOLE = CropTtaConfig(views=1)
MEAN = Aggregation.MEAN
BUNDLED = load_calibration(BUNDLED_CALIBRATION)


def job(members: int = 1, **settings: Any) -> GeotagJob:
    """Return a job of ``ihn``, or as ``settings`` of :class:`GeotagConfig` have it."""
    chosen: dict[str, Any] = {"estimator": "ihn"} | settings
    return GeotagJob(
        log_path=Path("none.tlog"),
        frames_path=Path("none"),
        map_path=Path("none.tif"),
        camera=CameraSpec(hfov_deg=45.0),
        config=GeotagConfig(**chosen),
        weights=tuple(Path(f"{k}.safetensors") for k in range(members)),
    )


@pytest.mark.parametrize(
    ("asked", "has_head", "expected"),
    [
        (job(3), True, UncertaintyChoice(UeMethod.CROPTTA_DE, Merge.MAX, MEAN)),
        (job(3, merge=Merge.ADD), False, UncertaintyChoice(UeMethod.CROPTTA_DE, Merge.ADD, MEAN)),
        (job(3, crops=WHOLE), True, UncertaintyChoice(UeMethod.DE, Merge.MAX, MEAN)),
        (job(1), True, UncertaintyChoice(UeMethod.CROPTTA)),
        (job(1, aggregation=MEAN), False, UncertaintyChoice(aggregation=MEAN)),
        (job(1, crops=WHOLE), True, UncertaintyChoice(UeMethod.DM)),
        (job(1, crops=WHOLE), False, UncertaintyChoice(UeMethod.NONE)),
        (job(1, ue=UeMethod.DM), True, UncertaintyChoice(UeMethod.DM)),
        (job(1, estimator="xcorr"), False, UncertaintyChoice(UeMethod.CROPTTA)),
        (job(3, estimator="xcorr"), False, UncertaintyChoice(UeMethod.CROPTTA)),
        (job(3, ue_iterations=2), False, UncertaintyChoice(UeMethod.CROPTTA_DE, Merge.MAX, MEAN)),
    ],
)
def test_a_run_uses_all_that_it_has(
    asked: GeotagJob, has_head: bool, expected: UncertaintyChoice
) -> None:
    assert chosen_uncertainty(asked, has_head=has_head) == expected


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        (job(1, ue=UeMethod.DE), "de needs an ensemble"),
        (job(3, ue=UeMethod.CROPTTA_DE, crops=WHOLE), "needs crops"),
        (job(1, ue=UeMethod.DM), "needs a network with a second head; ihn has none"),
        (job(1, estimator="xcorr", ue=UeMethod.DE), "xcorr averages the scores"),
        (job(3, estimator="xcorr", ue=UeMethod.CROPTTA_DE), "xcorr averages the scores"),
        (job(3, ue=UeMethod.CROPTTA), "--ue croptta asks one network alone"),
        (job(2, ue=UeMethod.DM), "--ue dm asks one network alone"),
        (job(1, merge=Merge.MAX), "croptta has nothing to merge"),
        (job(3, crops=WHOLE, merge=Merge.MIN), "de has nothing to merge"),
        (job(1, crops=WHOLE, aggregation=MEAN), "--aggregation mean needs several answers"),
        (job(1, ue_iterations=2, aggregation=MEAN), "leave out --aggregation mean"),
        (job(1, ue_iterations=2, crops=WHOLE), "stops crops early, and --ue none looks at none"),
        (job(3, ue_iterations=2, ue=UeMethod.DE), "stops crops early, and --ue de looks at none"),
        (
            job(1, ue=UeMethod.NONE, decision=DecisionConfig(max_std_m=5.0)),
            "--max-std limits deviations, and --ue none has none",
        ),
    ],
)
def test_contradictions_are_refused_before_anything_is_opened(asked: GeotagJob, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        chosen_uncertainty(asked, has_head=False)
    if asked.config.ue is not UeMethod.DM and "ue none looks" not in why:
        with pytest.raises(ValueError, match=why), open_run(asked):
            pass


def test_a_network_is_no_ensemble_with_itself() -> None:
    same = replace(job(), weights=(Path("a.safetensors"), Path("./a.safetensors")))
    with pytest.raises(ValueError, match=r"a\.safetensors is given twice"):
        chosen_uncertainty(same)


def test_weights_not_yet_seen_may_have_a_second_head() -> None:
    assert chosen_uncertainty(job(ue=UeMethod.DM)).method is UeMethod.DM
    with pytest.raises(ValueError, match="xcorr has none"):
        chosen_uncertainty(job(estimator="xcorr", ue=UeMethod.DM))


def test_a_calibration_that_judges_by_the_spread_wants_one() -> None:
    of_unknown_answers = replace(BUNDLED, made_of=None)
    calibrated = replace(job(estimator="xcorr", ue=UeMethod.NONE), calibration=of_unknown_answers)
    with pytest.raises(ValueError, match=r"--ue none leaves out u_m.* add --calibration none"):
        chosen_uncertainty(calibrated)
    one_view = replace(calibrated, config=replace(calibrated.config, ue=None, crops=WHOLE))
    with pytest.raises(ValueError, match="one view of each frame leaves out u_m"):
        chosen_uncertainty(one_view)
    assert chosen_uncertainty(replace(calibrated, calibration=None)).method is UeMethod.NONE


@pytest.mark.parametrize(
    ("made_of", "why"),
    [
        (AnswerKind("xcorr", "croptta"), None),
        (None, None),
        (AnswerKind("ncc", "croptta"), "made of --estimator ncc --ue croptta and promises nothing"),
        (AnswerKind("xcorr", "none"), "promises nothing of --estimator xcorr --ue croptta"),
    ],
)
def test_a_calibration_speaks_of_the_answers_it_was_made_of(
    made_of: AnswerKind | None, why: str | None
) -> None:
    calibrated = replace(job(estimator="xcorr"), calibration=replace(BUNDLED, made_of=made_of))
    if why is None:
        assert chosen_uncertainty(calibrated).method is UeMethod.CROPTTA
        return
    with pytest.raises(ValueError, match=why):
        chosen_uncertainty(calibrated)


def test_without_a_word_the_calibration_in_the_box_judges_what_it_was_made_of() -> None:
    default = GeotagJob(Path("a.tlog"), Path("frames"), Path("map.tif"), CameraSpec(hfov_deg=45.0))
    assert chosen_calibration(default) == BUNDLED
    assert chosen_calibration(replace(default, calibration=None)) is None
    own = replace(BUNDLED, note="my own")
    assert chosen_calibration(replace(default, calibration=own)) == own
    assert chosen_calibration(default, is_given=True) is None
    assert chosen_calibration(replace(default, weights=(Path("a.safetensors"),))) is None
    assert chosen_calibration(replace(default, config=GeotagConfig(ensemble=True))) is None
    for name in ("ncc", "ihn", "vismatch:xfeat"):
        assert chosen_calibration(job(estimator=name)) is None


def test_no_calibration_judges_an_estimator_of_another_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = "from uasthn_cli.matching.registry import XCORR\nfrom dataclasses import replace\n"
    source += "SPEC = replace(XCORR, name='theirs')\n"
    monkeypatch.delitem(sys.modules, "my_package", raising=False)
    points = "theirs = my_package:SPEC"
    pretend_installed(tmp_path, monkeypatch, "my-package", points, source)
    theirs = job(0, estimator="theirs")
    assert chosen_calibration(theirs) is None
    assert chosen_uncertainty(theirs).method is UeMethod.CROPTTA
    made_of = AnswerKind("theirs", "croptta")
    calibrated = replace(theirs, calibration=replace(BUNDLED, made_of=made_of))
    with pytest.raises(ValueError, match="no calibration judges theirs"):
        chosen_uncertainty(calibrated)


def test_what_weights_may_change_is_judged_when_they_are_known() -> None:
    made_of = AnswerKind("dhn", "none")
    terms = tuple(term for term in BUNDLED.single.model.terms if term.signal != "u_m")
    single = replace(BUNDLED.single, model=replace(BUNDLED.single.model, terms=terms))
    asked = job(estimator="dhn", crops=CropTtaConfig(views=1))
    calibrated = replace(
        asked, calibration=replace(BUNDLED, made_of=made_of, single=single, fused=None)
    )
    assert chosen_uncertainty(calibrated).method is UeMethod.DM
    assert chosen_uncertainty(calibrated, has_head=False).method is UeMethod.NONE
    with pytest.raises(ValueError, match="promises nothing of --estimator dhn --ue dm"):
        chosen_uncertainty(calibrated, has_head=True)


@pytest.mark.parametrize(
    ("asked", "obstacle", "settled", "is_warned"),
    [(3, None, 3, False), (3, "torch is loaded", 1, True), (None, "torch is loaded", 1, False)],
)
def test_fewer_processes_than_asked_for_are_said(
    asked: int | None,
    obstacle: str | None,
    settled: int,
    is_warned: bool,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr("uasthn_cli.pipeline.job.why_no_fork", lambda: obstacle)
    monkeypatch.setattr("uasthn_cli.pipeline.job.cores_for_jobs", lambda: 2)
    assert settled_jobs(replace(job(0, estimator="ncc"), jobs=asked)) == settled
    warnings = [record for record in caplog.records if record.levelname == "WARNING"]
    assert len(warnings) == is_warned
    assert ("torch is loaded" in caplog.text) == is_warned
