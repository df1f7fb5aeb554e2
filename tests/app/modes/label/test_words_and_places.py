"""What Label says of a ball and of its queue, and where it leads: on entry, and after an undo."""

from pathlib import Path

import numpy as np
import pytest

from app import theme
from app.modes.label.by_hand import place_ball
from app.modes.label.editor import LabelEditor
from app.modes.label.labelling import Grid
from app.modes.label.sightings import agreement_at, draft_at
from app.modes.label.status import Checked, here_html, save_html, status_words
from app.modes.label.suggestions import nothing_suspicious_words
from labels.model import PositionSource
from tests.app.modes.label.label_bench import BALL_US, Bench, propose


def test_a_circle_of_a_wrong_size_is_no_good_news_and_the_reason_comes_before_it(bench: Bench) -> None:
    for camera in ("right", "left"):
        bench.editor.change_view({"camera": camera})
        bench.click_truth(BALL_US)
    agreement = agreement_at(bench.work, BALL_US)
    right = bench.work.here.labels[BALL_US]
    assert agreement is not None and right.r_px is not None
    assert theme.BAD not in here_html(right, None, agreement, "", bench.work)
    bench.press(*["larger"] * 16)
    wrong = bench.work.here.labels[BALL_US]
    said = here_html(wrong, None, agreement, "why you are here", bench.work)
    assert f"radius {wrong.r_px:.1f} px, expected {agreement.expected_r_px:.1f} px" in said and theme.BAD in said
    assert said.count(theme.GOOD) == 1, "that of the label's state only"
    assert said.index("why you are here") < said.index("expected") < said.index("agree")


def test_the_queue_leads_to_the_label_of_a_wrong_size(bench: Bench) -> None:
    for camera in ("right", "left"):
        bench.editor.change_view({"camera": camera})
        for t_us in range(BALL_US, BALL_US + 30_000, 2000):
            bench.click_truth(t_us)
    wrong = BALL_US + 14_000
    bench.look(wrong)
    bench.press(*["larger"] * 16)
    bench.look(BALL_US)
    bench.suggestions.next_suspicious()
    bench.wait(lambda: bench.suggestions.reason)
    label = bench.work.here.labels[wrong]
    assert bench.work.t_us == wrong
    assert bench.suggestions.reason.startswith(f"radius {label.r_px:.1f} px, the cameras expect")


def test_a_circle_drawn_where_no_proposal_was_shown_is_by_hand(bench: Bench) -> None:
    bench.look(BALL_US)
    shown = bench.work.shown
    assert shown is not None
    propose(bench, BALL_US)
    draft = draft_at(bench.work, BALL_US)
    assert draft is not None
    bench.editor.show(shown)  # the detector was faster than the picture
    place_ball(bench.editor, draft.x_px + 2.0, draft.y_px, 8.0)
    bench.wait()
    assert bench.work.here.labels[BALL_US].provenance.source is PositionSource.BY_HAND
    bench.press("undo")
    bench.look(BALL_US)
    place_ball(bench.editor, draft.x_px + 2.0, draft.y_px, 8.0)
    bench.wait()
    assert bench.work.here.labels[BALL_US].provenance.source is PositionSource.CORRECTED


@pytest.mark.parametrize(
    ("checked", "share", "text", "open_ends"),
    [
        (Checked(1625, 0, 0), 0.66, "Nothing suspicious so far; 1,625 times unchecked, proposals 66 % done.", True),
        (Checked(1625, 1624, 9), None, "Nothing suspicious so far; 1 time unchecked.", True),
        (Checked(3, 3, 3), 0.5, "Nothing suspicious so far; proposals 50 % done.", True),
        (Checked(3, 3, 3), None, "No label or proposal looks wrong.", False),
    ],
)
def test_an_empty_queue_says_how_much_was_looked_at(
    checked: Checked, share: float | None, text: str, open_ends: bool
) -> None:
    assert nothing_suspicious_words(checked, share) == (text, open_ends)


def test_an_empty_queue_is_not_green_while_times_are_unchecked(bench: Bench) -> None:
    bench.click_truth(BALL_US)
    bench.suggestions.next_suspicious()
    bench.wait(lambda: bench.notes)
    note = bench.notes[-1]
    assert "times unchecked" in note.text and note.colour == "yellow"


def test_undo_of_a_segment_goes_back_to_where_it_was_accepted(bench: Bench) -> None:
    propose(bench, BALL_US)
    bench.press("accept_segment")
    assert bench.work.t_us > BALL_US and len(bench.work.here.labels) > 20
    bench.press("undo")
    assert bench.work.t_us == BALL_US
    bench.press("next", "redo")
    assert bench.work.t_us == BALL_US


FRAMES_US = np.array([500, 10_400, 20_300], np.int64)


@pytest.mark.parametrize(
    ("grid", "t_us", "nearest_us"),
    [
        (Grid(100_000, 2000), 79_500, 80_000),
        (Grid(100_000, 2000), 78_900, 78_000),
        (Grid(100_000, 2000), 80_000, 80_000),
        (Grid(100_000, 2000), 0, 0),
        (Grid(100_000, 2000), 100_000, 98_000),
        (Grid(100_000, 2000, FRAMES_US), 11_000, 10_400),
        (Grid(100_000, 2000, FRAMES_US), 90_000, 20_300),
        (Grid(100_000, 2000, FRAMES_US[:0]), 7, 7),
    ],
)
def test_the_time_to_label_that_is_nearest(grid: Grid, t_us: int, nearest_us: int) -> None:
    assert grid.nearest(t_us) == nearest_us


def test_an_empty_recording_has_no_time_to_label() -> None:
    assert [len(Grid(duration_us, 2000).times()) for duration_us in (0, 1, 2000, 2001)] == [0, 1, 1, 2]


def test_who_comes_from_between_the_times_to_label_goes_to_the_nearest_unless_a_label_is_there(bench: Bench) -> None:
    bench.editor.go_to(BALL_US + 1500)
    bench.editor.do(LabelEditor.enter)
    assert bench.work.t_us == BALL_US + 2000
    bench.click_truth(BALL_US + 500)
    bench.editor.do(LabelEditor.enter)
    assert bench.work.t_us == BALL_US + 500


def test_the_picture_does_not_repeat_what_the_panel_says_of_the_annotator_and_of_nothing_to_save(bench: Bench) -> None:
    words = [text for text, _ in status_words(bench.work, bench.editor.writer, Checked(300, 0, 0), None)]
    assert words == ["0 of 300", "unchecked"]


def test_labels_that_were_stored_before_are_all_saved(bench: Bench, tmp_path: Path, serve_recording: Path) -> None:
    assert "nothing to save" in save_html(bench.work, bench.editor.writer)
    bench.click_truth(BALL_US)
    again = Bench(tmp_path / "labels", serve_recording, session="another")
    try:
        assert "all saved" in save_html(again.work, again.editor.writer)
        assert status_words(again.work, again.editor.writer, Checked(1, 1, 1), None)[0][0] == "all saved"
    finally:
        again.close()
