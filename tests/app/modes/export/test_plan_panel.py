"""What is said of an export before it is made."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.export.exporter import ExportState
from app.export.formats import FORMATS
from app.modes.export.files_panel import result_of_kind
from app.modes.export.plan_panel import (
    NOBODY,
    UNCHOSEN,
    VIEW_FILM,
    VIEW_PICTURE,
    ExportPlan,
    ViewChoices,
    labels_left_out,
    made_with_html,
    part_around,
    part_of,
    parts_of,
    usual_annotator,
)
from core.detection import DetectorConfig, refined_config
from core.detection.saved import SavedDetector
from core.errors import CommandError
from core.events import Events, SensorSize
from core.recordings import open_recording
from core.recordings.writer import RecordingWriter

PLAN = ExportPlan(
    what="Recording", run=None, format="rrd", start_us=0, end_us=1, stride_us=4000, pictures=True, stages=True,
    plots=True, annotator="ann", asks_annotator=False, view=ViewChoices(960, 540, 25.0, 1.0),
)  # fmt: skip
PLAIN = SavedDetector("refined", refined_config())
CHANGED = SavedDetector("refined", DetectorConfig())
ON = np.ones(2, np.bool_)


def test_a_part_that_there_is_not_is_refused_in_the_words_of_its_fields(tmp_path: Path) -> None:
    sensor = SensorSize(64, 48)
    with RecordingWriter(tmp_path / "short.h5", {"left": sensor}, seed=1) as writer:
        writer.append("left", Events(np.array([0, 599_999]), np.ones(2, np.uint16), np.ones(2, np.uint16), ON, sensor))
    with open_recording(tmp_path / "short.h5") as recording:
        odd = replace(PLAN, start_us=500_000, end_us=100_000)
        with pytest.raises(CommandError, match=r"Part: .* expected From before To, .* 0\.6 s, got 0\.5 to 0\.1 s"):
            part_of(recording, odd)
        whole = part_of(recording, replace(odd, format=VIEW_PICTURE))
        assert (whole.start_us, whole.end_us) == (0, 600_000), "a picture has no part"


def test_nothing_is_exported_of_an_empty_recording(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "empty.h5", {"left": SensorSize(64, 48)}, seed=1):
        pass
    with open_recording(tmp_path / "empty.h5") as recording, pytest.raises(CommandError, match="is empty"):
        part_of(recording, replace(PLAN, start_us=0, end_us=0))


def test_a_computed_export_says_whether_the_config_was_changed() -> None:
    assert "Uses Tune's config A: method refined, default settings" in made_with_html(PLAN, PLAIN, "A", ())
    assert "config A: method refined, window.window_us 2000." in made_with_html(PLAN, CHANGED, "A", ())


def test_the_config_that_tune_shows_is_named() -> None:
    assert "Uses Tune's config B: method refined" in made_with_html(PLAN, PLAIN, "B", ())


def test_labels_that_are_left_out_have_a_reason_and_a_way_in() -> None:
    assert "only a Rerun file has labels" in made_with_html(replace(PLAN, format="csv"), PLAIN, "A", ("ann",))
    assert "chosen in Labels of" in made_with_html(replace(PLAN, annotator=None), PLAIN, "A", ("ann",))


@pytest.mark.parametrize(
    ("here_us", "span_us", "part_us"),
    [
        (100_000, (0, 3_250_000), (0, 2_000_000)),
        (1_500_000, (0, 3_250_000), (500_000, 2_500_000)),
        (3_200_000, (0, 3_250_000), (1_250_000, 3_250_000)),
        (700_000, (0, 900_000), (0, 900_000)),
        (5_000_000, (4_900_000, 9_000_000), (4_900_000, 6_900_000)),
    ],
)
def test_2_s_here_are_2_s_where_there_are(here_us: int, span_us: tuple[int, int], part_us: tuple[int, int]) -> None:
    assert part_around(here_us, span_us) == part_us


def test_2_s_are_offered_only_of_a_longer_recording() -> None:
    assert parts_of((0, 600_000)) == parts_of((0, 2_000_000)) == ("Everything",)
    assert parts_of((4_000_000, 6_000_001)) == ("Everything", "2 s here")


DONE = ExportState("demo-1.rrd", False, 1.0, 3.0, "demo-1.rrd: 2.1 MB", False)


@pytest.mark.parametrize(
    ("state", "made_as", "kind", "shown"),
    [
        (DONE, "rrd", "rrd", DONE),
        (DONE, "rrd", "html", None),
        (DONE, None, "html", DONE),  # before this page was loaded
        (replace(DONE, running=True), "rrd", "html", replace(DONE, running=True)),
        (None, None, "rrd", None),
    ],
)
def test_a_result_stands_below_the_kind_that_was_made(
    state: ExportState | None, made_as: str | None, kind: str, shown: ExportState | None
) -> None:
    assert result_of_kind(state, made_as, kind) == shown


@pytest.mark.parametrize("name", ["csv", "dsec", "evt3"])
def test_what_was_recorded_needs_no_detector_and_has_no_labels(name: str) -> None:
    assert name in FORMATS
    said = made_with_html(replace(PLAN, format=name), CHANGED, "A", ("ann",))
    assert "no detector" in said and "config A" not in said and "labels of ann" in said


def test_a_rerun_file_leaves_out_the_labels_of_the_others() -> None:
    assert labels_left_out(PLAN, ("ann", "bob")) == ("bob",)
    assert labels_left_out(replace(PLAN, annotator=None), ("ann", "bob")) == ("ann", "bob")
    assert "Left out" not in made_with_html(PLAN, CHANGED, "A", ("ann",))


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
    said = made_with_html(unknown, CHANGED, "A", ("ann", "bob"))
    assert "ann, bob" in said and "asked" in said and "Left out" not in said


def test_names_are_no_markup() -> None:
    assert "<b>" not in made_with_html(PLAN, CHANGED, "A", ("<b>",))
    unknown = replace(PLAN, annotator=None, asks_annotator=True)
    assert "<b>" not in made_with_html(unknown, CHANGED, "A", ("<b>", "ann"))


def test_nothing_is_said_of_a_run_or_of_what_the_browser_draws() -> None:
    assert made_with_html(replace(PLAN, what="Training run"), CHANGED, "A", ("bob",)) == ""
    assert made_with_html(replace(PLAN, format=VIEW_FILM), CHANGED, "A", ("bob",)) == ""
