"""What a person does with proposals: accept one, a segment or a flight; reject."""

import re
from dataclasses import replace

import numpy as np
import pytest

from app.modes.label.keys import ACTS
from app.modes.label.plan import centre_at, plan_at
from app.modes.label.sightings import agreement_at, draft_at
from app.modes.label.status import agreement_words
from app.modes.label.suggestions import add_proposals
from labels.assist import Proposals
from labels.model import PositionSource
from labels.store import LabelStore, Layer
from tests.app.modes.label.label_bench import BALL_US, DETECTOR, Bench, propose


def test_what_is_not_on_the_screen_is_not_accepted(bench: Bench) -> None:
    propose(bench, BALL_US)
    bench.look(BALL_US)
    bench.editor.do(ACTS["accept"])
    bench.editor.do(ACTS["accept"])  # the cursor is further, the picture is not
    bench.wait()
    assert sorted(bench.work.here.labels) == [BALL_US]


@pytest.mark.parametrize("key", ["accept", "reject"])
def test_a_proposal_outside_the_zoomed_picture_is_shown_before_it_is_judged(bench: Bench, key: str) -> None:
    propose(bench, BALL_US)
    bench.editor.change_view({"zoom": 10.0})
    bench.editor.go_to(BALL_US)
    draft = draft_at(bench.work, BALL_US)
    assert draft is not None
    away = plan_at(bench.scene(), BALL_US, (draft.x_px + 200.0, draft.y_px))  # it came after this was drawn
    bench.editor.show(away)
    for _ in range(2):  # a key that is held
        bench.editor.do(ACTS[key])
    bench.wait()
    assert not bench.work.here.labels and draft_at(bench.work, BALL_US) == draft and bench.work.t_us == BALL_US
    assert [note.title for note in bench.notes] == ["Not judged yet"]
    bench.editor.show(plan_at(bench.scene(), BALL_US, centre_at(bench.scene(), BALL_US, None)))
    bench.editor.do(ACTS[key])
    bench.wait()
    assert (BALL_US in bench.work.here.labels) == (key == "accept") and bench.work.here.draft(BALL_US) != draft


def test_a_rejected_proposal_is_gone_until_undo_and_the_time_stays_unchecked(bench: Bench) -> None:
    propose(bench, BALL_US)
    draft = bench.work.here.draft(BALL_US)
    assert draft is not None
    bench.look(BALL_US)
    bench.press("reject")
    assert bench.work.here.draft(BALL_US) is None and not bench.work.here.labels
    stored = LabelStore.read(bench.folder, Layer(bench.recording.uuid, "left", "anna"))
    assert bench.work.here.proposals is not None
    assert stored.rejected() == {(BALL_US, bench.work.here.proposals.detector)} == bench.work.saved["left"].rejected
    assert bench.work.saved["left"].can_undo
    bench.editor.step(+1)
    bench.press("undo")
    assert bench.work.here.draft(BALL_US) == draft and bench.work.t_us == BALL_US, "it is seen again"
    bench.press("redo")
    assert bench.work.here.draft(BALL_US) is None


def test_proposals_of_both_cameras_come_together(bench: Bench) -> None:
    bench.editor.go_to(BALL_US)
    bench.suggestions.toggle_propose(DETECTOR)
    bench.wait(lambda: any(work.proposals is not None for work in bench.work.works.values()))
    assert all(work.proposals is not None for work in bench.work.works.values())


def test_a_segment_without_proposals_says_so(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.editor.do(ACTS["accept_segment"])
    assert [note.title for note in bench.notes] == ["No proposals here"]


def test_a_segment_is_accepted_as_one_step(bench: Bench) -> None:
    propose(bench, BALL_US)
    bench.look(BALL_US)
    bench.editor.do(ACTS["accept_segment"])
    bench.wait()
    labels = bench.work.here.labels
    assert len(labels) > 20 and {label.provenance.source for label in labels.values()} == {PositionSource.ACCEPTED}
    truth = {t_us: bench.truth(t_us) for t_us in labels}
    assert max(abs((label.x_px or 0) - truth[t][0]) for t, label in labels.items()) < 2.0
    assert [(one.title, one.text.split()[0]) for one in bench.notes] == [("Segment accepted", str(len(labels)))]
    bench.look(BALL_US)
    bench.editor.do(ACTS["accept_segment"])
    bench.wait()
    assert bench.notes[-1].title == "Nothing to accept" and bench.work.here.labels == labels
    bench.press("undo")
    assert not bench.work.here.labels


def test_the_queue_of_a_camera_without_labels_and_proposals_finds_nothing_right(bench: Bench) -> None:
    bench.suggestions.next_suspicious()
    bench.wait(lambda: bench.notes)
    assert [(note.title, note.colour) for note in bench.notes] == [("Nothing to check", "yellow")]


@pytest.mark.gate
def test_a_whole_flight_is_accepted_in_both_cameras_and_leads_to_what_is_doubted(bench: Bench) -> None:
    propose(bench, BALL_US)
    bench.wait(lambda: bench.suggestions.share is None)  # it would put its own proposal over the wrong one
    proposals = bench.work.here.proposals
    assert proposals is not None
    wrong = np.flatnonzero((proposals.t_us > BALL_US + 20_000) & (proposals.t_us % 2000 == 0))[0]
    wrong_us = int(proposals.t_us[wrong])
    x_px = proposals.x_px.copy()
    x_px[wrong] += 9.0
    add_proposals(bench.editor, {"left": replace(proposals, x_px=x_px)})
    bench.look(BALL_US)
    bench.suggestions.take_flight()
    bench.wait(lambda: bench.notes)
    bench.wait()
    assert bench.notes[-1].title == "Flight accepted"
    for camera in ("left", "right"):
        labels = bench.work.works[camera].labels
        assert len(labels) > 40, camera
        errors = [
            np.hypot((label.x_px or 0) - u, (label.y_px or 0) - v)
            for t_us, label in labels.items()
            for u, v in [bench.truth(t_us, camera)]
        ]
        assert np.nanpercentile(errors, 95) < 1.0
        assert LabelStore.read(bench.folder, Layer(bench.recording.uuid, camera, "anna")).all() != ()
    assert wrong_us not in bench.work.here.labels
    assert bench.work.t_us == wrong_us and re.match(r"(8|9)\.\d px off the flight", bench.suggestions.reason)
    in_right = dict(bench.work.works["right"].labels)
    bench.press("undo")
    assert not bench.work.here.labels and not bench.work.works["right"].labels
    bench.press("redo")
    assert bench.work.here.labels and bench.work.works["right"].labels == in_right


def test_a_flight_that_is_none_says_so_and_labels_nothing(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.suggestions.take_flight()
    bench.wait(lambda: bench.notes)
    assert [note.title for note in bench.notes] == ["No proposals here"]
    propose(bench, BALL_US)
    bench.wait(lambda: bench.suggestions.share is None)
    still = {
        name: replace(work.proposals, x_px=np.full(len(work.proposals), 100.0), y_px=np.full(len(work.proposals), 90.0))
        for name, work in bench.work.works.items()
        if work.proposals is not None
    }
    add_proposals(bench.editor, still)
    bench.look(BALL_US)
    bench.suggestions.take_flight()
    bench.wait(lambda: len(bench.notes) == 2)
    assert bench.notes[-1].title == "No flight here"
    assert not any(work.labels for work in bench.work.works.values())


def test_a_label_that_only_a_proposal_of_the_other_camera_contradicts_comes_first_in_the_queue(bench: Bench) -> None:
    bench.click_truth(BALL_US)
    bench.press(*["down_more"] * 14)
    x, y = bench.truth(BALL_US, "right")
    one = Proposals(
        np.array([BALL_US]), np.array([x]), np.array([y]), np.array([9.0]), np.array([[0.01, 0.0, 0.01]]), 2000, "d"
    )
    add_proposals(bench.editor, {"right": one})
    agreement = agreement_at(bench.work, BALL_US)
    assert agreement is not None and agreement_words(agreement) == "cameras disagree by"
    bench.suggestions.next_suspicious()
    bench.wait(lambda: bench.suggestions.reason)
    assert bench.suggestions.reason == f"the cameras disagree by {agreement.residual_px:.1f} px"
    assert bench.work.t_us == BALL_US
