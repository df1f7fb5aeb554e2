import xml.etree.ElementTree as ET

import numpy as np
import pytest

from core.metrics import WindowAnswers
from labels.arrays import LabelArrays, label_arrays
from labels.model import Label, LabelState
from labels.score import TOLERANCES_PX, score_groups
from labels.score_picture import TOLERANCES, ScoreCurves, measure_curves, score_svg


def example() -> tuple[WindowAnswers, LabelArrays]:
    """Ten balls, of which eight are answered with growing errors, and two empty times, of which one is answered."""
    balls = [Label(t_us=1000 * k, state=LabelState.VISIBLE, x_px=100.0 + 10 * k, y_px=50.0) for k in range(10)]
    labels = label_arrays([*balls, *(Label(t_us=20_000 + 1000 * k, state=LabelState.NO_BALL) for k in range(2))])
    u = np.array([100.0 + 10 * k + 0.9 * k for k in range(8)] + [np.nan, np.nan, 7.0, np.nan])
    v = np.where(np.isnan(u), np.nan, 50.0)
    none = np.zeros(12, np.int32)
    return WindowAnswers(labels.t_us, labels.t_us, u, v, v, none), labels


def test_the_curves_say_what_the_table_says() -> None:
    answers, labels = example()
    curves, (score, *_) = measure_curves(answers, labels), score_groups(answers, labels)
    for at in score.at:
        row = int(np.argmin(np.abs(TOLERANCES - at.tolerance_px)))
        assert TOLERANCES[row] == pytest.approx(at.tolerance_px) and at.tolerance_px in TOLERANCES_PX
        assert curves.precision[row] == pytest.approx(at.precision)
        assert curves.recall[row] == pytest.approx(at.recall)
    assert curves.precision[-1] == pytest.approx(8 / 9) and curves.recall[-1] == pytest.approx(0.8)
    assert np.allclose(curves.errors_px[:, 0], 0.9 * np.arange(8)) and np.allclose(curves.errors_px[:, 1], 0)


def test_the_picture_has_a_dot_for_each_error_and_is_proper_xml() -> None:
    answers, labels = example()
    root = ET.fromstring(score_svg(measure_curves(answers, labels), "a < b & c", noise_px=0.4))
    names = [element.tag.rsplit("}")[-1] for element in root.iter()]
    assert names.count("polyline") == 2 and names.count("circle") == 8 + 1
    assert "a < b & c" in [element.text for element in root.iter()]


def test_errors_beyond_the_scatter_are_counted() -> None:
    answers, labels = example()
    curves = measure_curves(answers, labels)
    assert "3 beyond 4 px" in score_svg(curves, "4.5, 5.4 and 6.3 px")
    within = ScoreCurves(curves.precision, curves.recall, curves.errors_px[:5])
    assert "beyond" not in score_svg(within, "at most 3.6 px")


def test_nothing_answered_and_nothing_labelled_are_pictures_too() -> None:
    empty = np.zeros(0)
    answers = WindowAnswers(empty.astype(int), empty.astype(int), empty, empty, empty, empty.astype(np.int32))
    curves = measure_curves(answers, label_arrays(()))
    assert np.isnan(curves.precision).all() and np.isnan(curves.recall).all() and curves.errors_px.shape == (0, 2)
    assert curves.precision.shape == curves.recall.shape == TOLERANCES.shape
    svg = score_svg(curves, "nothing", noise_px=float("nan"))
    names = [element.tag.rsplit("}")[-1] for element in ET.fromstring(svg).iter()]
    assert "polyline" not in names and "circle" not in names and "path" in names
    assert "nothing" in svg and "nan" not in svg
