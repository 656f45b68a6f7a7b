import io
from xml.etree import ElementTree

import numpy as np
from known_estimator import made_up_predictions
from PIL import Image

from uasthn_cli.config import DecisionConfig, UeMethod
from uasthn_cli.evaluation.figures import FIGURES, Curve, draw_evaluation
from uasthn_cli.evaluation.judging import JudgingConfig, judge

CONFIG = JudgingConfig(DecisionConfig(max_std_m=10.0))
RNG = np.random.default_rng(1)
ERRORS_M = RNG.exponential(30.0, 60)


def curves(*methods: UeMethod, errors_m: np.ndarray = ERRORS_M) -> list[Curve]:
    some = made_up_predictions(errors_m, errors_m / 3 + 1.0, members=3)
    return [Curve("known", method, judge(some, method, CONFIG)) for method in methods]


def test_every_figure_is_a_picture() -> None:
    drawn = draw_evaluation(curves(*list(UeMethod)[:1], UeMethod.CROPTTA), 25.0, "png")
    assert set(drawn) == set(FIGURES)
    for content in drawn.values():
        assert content is not None
        assert Image.open(io.BytesIO(content)).size[0] >= 800
    for content in draw_evaluation(curves(UeMethod.CROPTTA), 25.0, "svg").values():
        assert content is not None
        ElementTree.fromstring(content)


def test_the_same_curves_give_the_same_bytes() -> None:
    for file_format in ("png", "svg"):
        first = draw_evaluation(curves(UeMethod.CROPTTA), 25.0, file_format)
        assert draw_evaluation(curves(UeMethod.CROPTTA), 25.0, file_format) == first


def test_without_uncertainty_or_wrong_answers_there_is_no_roc() -> None:
    assert draw_evaluation(curves(UeMethod.NONE), 25.0, "png")["roc"] is None
    good = curves(UeMethod.CROPTTA, errors_m=np.array([1.0, 2.0, 3.0]))
    drawn = draw_evaluation(good, 25.0, "png")
    assert drawn["roc"] is None
    assert drawn["mace-histogram"] is not None


def test_errors_that_are_alike_are_drawn_once() -> None:
    one = draw_evaluation(curves(UeMethod.CROPTTA), 25.0, "svg")["mace-histogram"]
    two = draw_evaluation(curves(UeMethod.CROPTTA, UeMethod.NONE), 25.0, "svg")["mace-histogram"]
    assert one == two
