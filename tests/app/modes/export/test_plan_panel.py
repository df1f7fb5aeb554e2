"""What is said of an export before it is made."""

from dataclasses import replace

import pytest

from app.export.formats import FORMATS
from app.modes.export.plan_panel import VIEW_FILM, ExportPlan, ViewChoices, labels_left_out, made_with_html
from core.detection import DetectorConfig, refined_config
from core.detection.saved import SavedDetector

PLAN = ExportPlan(
    what="Recording", run=None, format="rrd", start_us=0, end_us=1, stride_us=4000, pictures=True, stages=True,
    plots=True, annotator="ann", view=ViewChoices(960, 540, 25.0, 1.0),
)  # fmt: skip
PLAIN = SavedDetector("refined", refined_config())
CHANGED = SavedDetector("refined", DetectorConfig())


def test_a_computed_export_says_whether_the_config_was_changed() -> None:
    assert "Uses Tune's config A: method refined, default settings" in made_with_html(PLAN, PLAIN, ())
    assert "settings changed in Tune" in made_with_html(PLAN, CHANGED, ())


@pytest.mark.parametrize("name", ["csv", "dsec", "evt3"])
def test_what_was_recorded_needs_no_detector_and_has_no_labels(name: str) -> None:
    assert name in FORMATS
    said = made_with_html(replace(PLAN, format=name), CHANGED, ("ann",))
    assert "no detector" in said and "config A" not in said and "labels of ann" in said


def test_a_rerun_file_leaves_out_the_labels_of_the_others() -> None:
    assert labels_left_out(PLAN, ("ann", "bob")) == ("bob",)
    assert labels_left_out(replace(PLAN, annotator=None), ("ann", "bob")) == ("ann", "bob")
    assert "Left out" not in made_with_html(PLAN, CHANGED, ("ann",))


def test_names_are_no_markup() -> None:
    assert "<b>" not in made_with_html(PLAN, CHANGED, ("<b>",))


def test_nothing_is_said_of_a_run_or_of_what_the_browser_draws() -> None:
    assert made_with_html(replace(PLAN, what="Training run"), CHANGED, ("bob",)) == ""
    assert made_with_html(replace(PLAN, format=VIEW_FILM), CHANGED, ("bob",)) == ""
