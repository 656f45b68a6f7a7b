"""Estimators of other packages: usable by name, refused in one line."""

import sys
from pathlib import Path

import pytest
from plugin_packages import EXAMPLE, pretend_installed

from uasthn_cli.errors import PluginError, WeightsError
from uasthn_cli.matching import registry
from uasthn_cli.matching.registry import code_of, estimator_names, open_estimator, spec_of
from uasthn_cli.version import code_version

SOURCE = """
from uasthn_cli.matching.spec import EstimatorSpec
from uasthn_cli.matching.ncc import NccEstimator

def opened(opening):
    estimator = NccEstimator()
    estimator.name = "{called}"
    return estimator

SPEC = EstimatorSpec(name="{name}", open={open})
"""


def source(name: str = "other", called: str = "other", opening: str = "opened") -> str:
    return SOURCE.format(name=name, called=called, open=opening)


@pytest.fixture(autouse=True)
def _forget(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("my_package", "your_package"):
        monkeypatch.delitem(sys.modules, module, raising=False)


def test_the_example_is_known_by_name_and_loaded_when_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = "uasthn_gradient_ncc"
    monkeypatch.delitem(sys.modules, module, raising=False)
    assert "gradient-ncc" not in estimator_names()
    code = (EXAMPLE / f"{module}.py").read_text("utf-8")
    points = f"gradient-ncc = {module}:SPEC"
    pretend_installed(tmp_path, monkeypatch, "uasthn-gradient-ncc", points, code)
    assert estimator_names()[-1] == "gradient-ncc"
    assert module not in sys.modules
    spec = spec_of("gradient-ncc")
    assert (spec.working_width_px, spec.calibration) == (96, None)
    assert open_estimator("gradient-ncc").name == "gradient-ncc"
    with pytest.raises(WeightsError, match="gradient-ncc uses no weights"):
        open_estimator("gradient-ncc", weights=[tmp_path])


def test_its_code_is_part_of_what_a_run_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = []
    for place, edit in (("a", ""), ("b", "# edited\n")):
        with monkeypatch.context() as patched:
            patched.delitem(sys.modules, "my_package", raising=False)
            pretend_installed(
                tmp_path / place, patched, "my-package", "other = my_package:SPEC", source() + edit
            )
            told.append(code_of("other"))
    assert told[0].startswith(f"{code_version()}, my-package 0.1+src.")
    assert told[0] != told[1]
    assert code_of("ncc") == code_version()


@pytest.mark.parametrize(
    ("code", "why"),
    [
        ("import nothing_of_that_name", "ModuleNotFoundError: No module named"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("", "AttributeError"),
        ("SPEC = 'ncc'", "my_package:SPEC is no EstimatorSpec but str"),
        (source(name="another"), "its EstimatorSpec is called 'another'"),
        (source(called="ncc"), "what it opens is called 'ncc'"),
        (source(opening="lambda _: 1 / 0"), "ZeroDivisionError: division by zero"),
    ],
)
def test_a_broken_package_is_named_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, why: str
) -> None:
    pretend_installed(tmp_path, monkeypatch, "my-package", "other = my_package:SPEC", code)
    with pytest.raises(PluginError) as caught:
        open_estimator("other")
    message = str(caught.value)
    assert message.startswith("--estimator other of my-package 0.1 cannot be used: ")
    assert why in message
    assert "\n" not in message
    assert open_estimator("ncc").name == "ncc"


@pytest.mark.parametrize("name", ["ncc", "vismatch"])
def test_a_built_in_name_cannot_be_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    points, code = f"{name} = my_package:SPEC", source(name=name)
    pretend_installed(tmp_path, monkeypatch, "my-package", points, code)
    asked = name if name in registry.BUILT_IN and name != "vismatch" else "vismatch:xfeat"
    with pytest.raises(PluginError, match=rf"my-package 0\.1 offers an estimator '{name}'"):
        spec_of(asked)
    assert "my_package" not in sys.modules
    assert spec_of("xcorr").name == "xcorr"
    assert estimator_names().count(name) == (name == "ncc")


def test_two_packages_with_one_name_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for package in ("my-package", "your-package"):
        point = f"other = {package.replace('-', '_')}:SPEC"
        pretend_installed(tmp_path / package, monkeypatch, package, point, source())
    with pytest.raises(PluginError, match=r"my-package 0\.1 both offer an estimator 'other'"):
        spec_of("other")
