"""What is said of an export before it is made."""

from dataclasses import replace

import pytest

from app.export.formats import FORMATS
from app.modes.export.plan_panel import (
    NOBODY,
    UNCHOSEN,
    VIEW_FILM,
    ExportPlan,
    ViewChoices,
    labels_left_out,
    made_with_html,
    usual_annotator,
)
from core.detection import DetectorConfig, refined_config
from core.detection.saved import SavedDetector

PLAN = ExportPlan(
    what="Recording", run=None, format="rrd", start_us=0, end_us=1, stride_us=4000, pictures=True, stages=True,
    plots=True, annotator="ann", asks_annotator=False, view=ViewChoices(960, 540, 25.0, 1.0),
)  # fmt: skip
PLAIN = SavedDetector("refined", refined_config())
CHANGED = SavedDetector("refined", DetectorConfig())


def test_a_computed_export_says_whether_the_config_was_changed() -> None:
    assert "Uses Tune's config A: method refined, default settings" in made_with_html(PLAN, PLAIN, ())
    assert "config A: method refined, window.window_us 2000." in made_with_html(PLAN, CHANGED, ())


@pytest.mark.parametrize("name", ["csv", "dsec", "evt3"])
def test_what_was_recorded_needs_no_detector_and_has_no_labels(name: str) -> None:
    assert name in FORMATS
    said = made_with_html(replace(PLAN, format=name), CHANGED, ("ann",))
    assert "no detector" in said and "config A" not in said and "labels of ann" in said


def test_a_rerun_file_leaves_out_the_labels_of_the_others() -> None:
    assert labels_left_out(PLAN, ("ann", "bob")) == ("bob",)
    assert labels_left_out(replace(PLAN, annotator=None), ("ann", "bob")) == ("ann", "bob")
    assert "Left out" not in made_with_html(PLAN, CHANGED, ("ann",))


@pytest.mark.parametrize(
    ("annotators", "signed_in", "usual"),
    [
        (("a", "anna"), "anna", "anna"),
        (("a", "anna"), "emil", UNCHOSEN),
        (("a", "anna"), None, UNCHOSEN),
        (("a",), None, "a"),
        (("a",), "emil", "a"),
        ((), "anna", NOBODY),
    ],
)
def test_the_labels_are_those_of_who_is_signed_in_or_of_the_only_one(annotators, signed_in, usual) -> None:
    assert usual_annotator(annotators, signed_in) == usual


def test_it_says_before_the_export_that_it_will_ask_whose_labels_are_meant() -> None:
    unknown = replace(PLAN, annotator=None, asks_annotator=True)
    said = made_with_html(unknown, CHANGED, ("ann", "bob"))
    assert "ann, bob" in said and "asked" in said and "Left out" not in said


def test_names_are_no_markup() -> None:
    assert "<b>" not in made_with_html(PLAN, CHANGED, ("<b>",))
    unknown = replace(PLAN, annotator=None, asks_annotator=True)
    assert "<b>" not in made_with_html(unknown, CHANGED, ("<b>", "ann"))


def test_nothing_is_said_of_a_run_or_of_what_the_browser_draws() -> None:
    assert made_with_html(replace(PLAN, what="Training run"), CHANGED, ("bob",)) == ""
    assert made_with_html(replace(PLAN, format=VIEW_FILM), CHANGED, ("bob",)) == ""
