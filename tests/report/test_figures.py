import io
import sys
import warnings
from dataclasses import replace
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image
from report_runs import FIVE_ROWS, fused_rows, make_run

from uasthn_cli.errors import MissingExtraError
from uasthn_cli.report.figures import NEEDS, draw_run
from uasthn_cli.report.load import RunResults


def drawn(run: RunResults) -> set[str]:
    return {name for name, content in draw_run(run).items() if content is not None}


def test_all_figures_of_a_run_with_every_signal() -> None:
    for name, content in draw_run(make_run(*fused_rows())).items():
        assert name in NEEDS
        assert content is not None
        with Image.open(io.BytesIO(content)) as picture:
            assert picture.format == "PNG"
            assert picture.width == 800
            pixels = np.asarray(picture.convert("RGB"))
        assert (pixels != 255).mean() > 0.02
        edge = np.concatenate([pixels[:2].ravel(), pixels[:, :2].ravel(), pixels[:, -2:].ravel()])
        assert edge.min() == 255, "something is cut off"


def test_svg_is_well_formed_and_undated() -> None:
    for content in draw_run(make_run(*fused_rows()), file_format="svg").values():
        assert content is not None
        assert ElementTree.fromstring(content).tag.endswith("}svg")
        assert b"<dc:date>" not in content


@pytest.mark.parametrize("file_format", ["png", "svg"])
def test_same_run_same_bytes_whatever_the_users_style(file_format: str) -> None:
    run = make_run(*fused_rows())
    first = draw_run(run, file_format=file_format)
    with mpl.rc_context({"font.size": 30.0, "axes.grid": False}):
        assert draw_run(run, file_format=file_format) == first
        assert mpl.rcParams["font.size"] == 30.0


def test_only_what_there_is_is_drawn() -> None:
    assert drawn(make_run()) == {"errors"}
    assert drawn(make_run(rows=())) == set()
    with_signal = [replace(row, u_m=1.0) for row in FIVE_ROWS]
    assert drawn(make_run(*with_signal)) == {"errors", "risk-coverage", "roc"}
    assert drawn(make_run(*with_signal[:1])) == {"errors", "risk-coverage"}
    with_risk = [replace(row, risk=0.5) for row in FIVE_ROWS]
    assert drawn(make_run(*with_risk)) == set(NEEDS)


def test_a_radius_and_an_error_of_nothing_are_drawn() -> None:
    rows = [replace(row, ce90_m=0.0, ce_m=float(k)) for k, row in enumerate(FIVE_ROWS[:2])]
    with warnings.catch_warnings(action="error"):
        assert drawn(make_run(*rows)) == {"errors"}


def test_names_that_look_like_formulas_or_have_no_end_are_drawn() -> None:
    assert drawn(make_run(*fused_rows(), name="$x^$" + 50 * "long/")) == set(NEEDS)


def test_without_matplotlib_there_is_one_line_that_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for module in ("uasthn_cli.report.figures", "uasthn_cli.report.drawing"):
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'uasthn\[figures\]'") as raised:
        import uasthn_cli.report.figures  # noqa: F401, PLC0415
    assert raised.value.exit_code == 26
    assert "\n" not in str(raised.value)
