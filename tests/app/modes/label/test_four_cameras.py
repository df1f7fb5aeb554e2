"""Four cameras: what labels in two of them propose in the others, and what one key accepts."""

from dataclasses import replace

import numpy as np
import pytest

from app.modes.label.label_picture import LineMark, PointMark
from app.modes.label.sightings import FROM_OTHERS, agreement_at, draft_at
from app.modes.label.status import agreement_words
from app.modes.label.suggestions import add_proposals
from labels.model import PositionSource
from labels.store import LabelStore, Layer
from tests.app.modes.label.label_bench import BALL_US, FOUR, Bench, labelled_in, propose


def test_labels_in_two_cameras_propose_the_ball_in_the_others_and_one_key_accepts_it_there(four: Bench) -> None:
    for camera in FOUR[:2]:
        assert all(draft_at(four.work, BALL_US, name) is None for name in FOUR)
        four.editor.change_view({"camera": camera})
        four.click_truth(BALL_US)
    for name in FOUR[2:]:
        draft = draft_at(four.work, BALL_US, name)
        assert draft is not None and draft.detector == FROM_OTHERS and draft.covariance_px2 is not None
        assert np.hypot(*np.subtract((draft.x_px, draft.y_px), four.truth(BALL_US, name))) < 1.0
    four.press("accept_all")
    assert labelled_in(four, BALL_US) == set(FOUR) and four.work.t_us == BALL_US + 2000
    for name in FOUR:
        label = LabelStore.read(four.folder, Layer(four.recording.uuid, name, "anna")).at(BALL_US)
        assert label is not None and label.x_px is not None and label.y_px is not None
        assert np.hypot(*np.subtract((label.x_px, label.y_px), four.truth(BALL_US, name))) < 0.5
        made = label.provenance
        expected = (PositionSource.SNAPPED, "") if name in FOUR[:2] else (PositionSource.ACCEPTED, FROM_OTHERS)
        assert (made.source, made.detector) == expected
    four.editor.go_to(BALL_US)
    four.press("undo")
    assert labelled_in(four, BALL_US) == set(FOUR) - {four.work.view.camera}, "its click: the key changed others only"
    four.press("redo")
    assert labelled_in(four, BALL_US) == set(FOUR)
    four.editor.change_view({"camera": FOUR[2]})
    four.press("undo")
    assert labelled_in(four, BALL_US) == set(FOUR[:2]), "what one key accepted goes at once"
    four.press("redo", "right", "undo")
    four.editor.change_view({"camera": FOUR[3]})
    four.press("right")
    four.editor.change_view({"camera": FOUR[2]})
    four.press("undo")
    assert labelled_in(four, BALL_US) == set(FOUR) - {FOUR[2]}, "what was changed since stays"


@pytest.mark.gate
def test_what_follows_from_the_labels_is_shown_before_it_is_accepted_and_can_be_rejected(four: Bench) -> None:
    propose(four, BALL_US)
    four.wait(lambda: four.suggestions.share is None)
    blind = four.work.works["far_right"]
    assert blind.proposals is not None
    add = replace(four.work, works={**four.work.works, "far_right": replace(blind, proposals=None)})
    four.editor.labelling = add
    four.press("accept_all")
    assert labelled_in(four, BALL_US) == set(FOUR[:3]) and four.work.t_us == BALL_US, "something new is proposed"
    four.editor.change_view({"camera": "far_right"})
    four.press("reject")
    assert draft_at(four.work, BALL_US) is None
    four.press("accept_all")
    assert labelled_in(four, BALL_US) == set(FOUR[:3]) and four.work.t_us == BALL_US + 2000


def test_all_other_cameras_rays_and_their_ball_with_its_ellipse_are_drawn(four: Bench) -> None:
    def drawn(key) -> tuple[int, list[PointMark]]:
        rays = [mark for mark in key.marks if isinstance(mark, LineMark)]
        return len(rays), [mark for mark in key.marks if isinstance(mark, PointMark)]

    counts = []
    for camera in FOUR[:3]:
        four.editor.change_view({"camera": camera})
        four.click_truth(BALL_US, off_px=0.0)
        four.editor.change_view({"camera": "near_left"})
        plan = four.look(BALL_US)
        assert [key.camera for key in plan.others] == list(FOUR[1:])
        counts.append((drawn(plan.main)[0], drawn(plan.others[2])[0]))
    assert counts == [(0, 1), (1, 1), (2, 1)]
    (point,) = drawn(plan.main)[1]
    assert (point.x_px, point.y_px) == pytest.approx(four.truth(BALL_US, "near_left"), abs=1.0)
    assert point.covariance_px2[0] > 0
    four.editor.change_view({"epipolar": False})
    assert drawn(four.look(BALL_US).main) == (0, [])


def test_the_residual_of_each_camera_tells_which_one_has_something_else(four: Bench) -> None:
    for camera in FOUR:
        four.editor.change_view({"camera": camera})
        four.click_truth(BALL_US)
    four.look(BALL_US)
    good = agreement_at(four.work, BALL_US)
    assert good is not None and set(good.off_px) == set(FOUR) and max(good.off_px.values()) < 0.6
    four.press(*["down_more"] * 12)
    bad = agreement_at(four.work, BALL_US)
    assert bad is not None and bad.left_out == {"far_right"} and 11 < bad.off_px["far_right"] < 13
    assert bad.residual_px < 0.6 and agreement_words(bad) == "3 of 4 cameras agree to"
    assert agreement_words(replace(bad, residual_px=8.41, off_px={})) == "cameras disagree by"
    four.suggestions.next_suspicious()
    four.wait(lambda: four.suggestions.reason)
    assert "the cameras disagree" in four.suggestions.reason


def test_a_whole_flight_is_accepted_in_four_cameras_though_one_sees_a_person(four: Bench) -> None:
    propose(four, BALL_US)
    four.wait(lambda: four.suggestions.share is None)
    part = four.work.works["far_left"].proposals
    assert part is not None
    add_proposals(four.editor, {"far_left": replace(part, x_px=100.0 + 0.0 * part.x_px, y_px=90.0 + 0.0 * part.y_px)})
    four.look(BALL_US)
    four.suggestions.take_flight()
    four.wait(lambda: four.notes)
    four.wait()
    assert four.notes[-1].title == "Flight accepted" and "4 cameras" in four.notes[-1].text
    counts = {name: len(work.labels) for name, work in four.work.works.items()}
    assert counts.pop("far_left") < 3 and min(counts.values()) > 30, counts
    for name in counts:
        labels = four.work.works[name].labels
        errors = [np.hypot(*np.subtract((one.x_px, one.y_px), four.truth(t, name))) for t, one in labels.items()]
        assert np.nanpercentile(errors, 95) < 1.0
