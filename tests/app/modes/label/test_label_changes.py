from dataclasses import replace

import numpy as np
import pytest

from app.modes.label.label_changes import (
    ProposedLabel,
    ShownPicture,
    accepted,
    copied,
    label_from_click,
    moved,
    placed,
    proposed_at,
    with_state,
)
from labels.assist import Proposals
from labels.model import Label, LabelState, PositionSource

JUDGED = ShownPicture(5_000, (4_000, 6_000), "polarity", 700)
DRAFT = ProposedLabel(5_000, 50.0, 60.0, 7.0, (0.1, 0.0, 0.2), "auto#abc")
BY_HAND = label_from_click(10.0, 20.0, JUDGED, None, None, r_px=5.0)


def test_a_click_says_on_what_it_was_judged() -> None:
    made = BY_HAND.provenance
    assert (made.source, made.window_us, made.rendering, made.time_spent_ms) == (
        PositionSource.BY_HAND, (4_000, 6_000), "polarity", 700,
    )  # fmt: skip
    assert BY_HAND.state is LabelState.VISIBLE and BY_HAND.r_px == 5.0


def test_a_click_where_something_was_proposed_is_a_correction_of_it() -> None:
    label = label_from_click(51.0, 60.0, JUDGED, None, DRAFT)
    assert (label.provenance.source, label.provenance.detector, label.r_px) == (
        PositionSource.CORRECTED,
        "auto#abc",
        7.0,
    )


@pytest.mark.parametrize(
    ("x_px", "r_px", "source"),
    [
        (50.0, 7.0, PositionSource.CORRECTED),
        (57.0, 7.0, PositionSource.CORRECTED),  # on the proposal's rim
        (57.1, 7.0, PositionSource.BY_HAND),
        (300.0, 7.0, PositionSource.BY_HAND),
        (52.9, 1.5, PositionSource.CORRECTED),  # beside a ball of three pixels, as a hand is
        (53.1, 1.5, PositionSource.BY_HAND),
        (52.9, None, PositionSource.CORRECTED),
        (53.1, None, PositionSource.BY_HAND),
    ],
)
def test_a_click_beside_what_was_proposed_corrects_nothing(
    x_px: float, r_px: float | None, source: PositionSource
) -> None:
    label = label_from_click(x_px, 60.0, JUDGED, None, replace(DRAFT, r_px=r_px))
    corrects = source is PositionSource.CORRECTED
    assert label.provenance.source is source
    assert label.provenance.detector == ("auto#abc" if corrects else "")
    assert label.r_px == (r_px if corrects else None), "how large another thing is says nothing of this one"


def test_an_accepted_label_that_is_put_elsewhere_is_no_correction_and_keeps_its_radius() -> None:
    for made in (
        label_from_click(90.0, 60.0, JUDGED, accepted(DRAFT, JUDGED), DRAFT),
        placed(accepted(DRAFT, JUDGED), 90.0, 60.0, 7.0, JUDGED),
    ):
        assert (made.provenance.source, made.provenance.detector) == (PositionSource.BY_HAND, "")
        assert made.r_px == 7.0


def test_a_second_click_keeps_radius_and_state() -> None:
    before = with_state(LabelState.PARTLY_OCCLUDED, BY_HAND, None, JUDGED)
    label = label_from_click(11.0, 21.0, JUDGED, before, None)
    assert (label.r_px, label.state) == (5.0, LabelState.PARTLY_OCCLUDED)


def test_accepting_keeps_every_number_of_the_draft() -> None:
    label = accepted(DRAFT, JUDGED)
    assert (label.x_px, label.y_px, label.r_px, label.covariance_px2) == (50.0, 60.0, 7.0, (0.1, 0.0, 0.2))
    assert label.provenance.source is PositionSource.ACCEPTED


def test_what_was_accepted_and_moved_is_corrected_and_no_longer_as_certain() -> None:
    label = moved(accepted(DRAFT, JUDGED), 0.25, 0.0, JUDGED)
    assert label is not None
    assert (label.x_px, label.provenance.source, label.covariance_px2) == (50.25, PositionSource.CORRECTED, None)


def test_a_new_radius_alone_leaves_the_centre_as_certain_as_it_was() -> None:
    label = placed(accepted(DRAFT, JUDGED), 50.0, 60.0, 8.0, JUDGED)
    assert label.covariance_px2 == (0.1, 0.0, 0.2) and label.r_px == 8.0


def test_no_ball_has_no_position_and_other_states_keep_theirs() -> None:
    empty = with_state(LabelState.NO_BALL, BY_HAND, DRAFT, JUDGED)
    assert empty is not None and empty.x_px is None
    covered = with_state(LabelState.OCCLUDED, BY_HAND, None, JUDGED)
    assert covered is not None and covered.x_px == 10.0
    assert with_state(LabelState.OCCLUDED, None, None, JUDGED) is not None
    assert with_state(LabelState.VISIBLE, None, None, JUDGED) is None
    assert with_state(LabelState.VISIBLE, empty, None, JUDGED) is None


def test_a_label_without_a_position_cannot_be_nudged() -> None:
    assert moved(Label(t_us=1, state=LabelState.NO_BALL), 1.0, 0.0, JUDGED) is None


def test_a_copy_is_made_by_hand_at_another_time() -> None:
    label = copied(accepted(DRAFT, ShownPicture(1, (0, 2), "", 0)), JUDGED)
    assert (label.t_us, label.x_px, label.provenance.source) == (5_000, 50.0, PositionSource.BY_HAND)


def test_drafts_lie_between_two_proposals_and_never_beyond_them() -> None:
    t, xs = np.array([0, 2000, 20_000]), np.array([1.0, 3.0, 9.0])
    proposals = Proposals(t, xs, xs, xs, np.full((3, 3), np.nan), 2000, "auto#1")
    draft = proposed_at(proposals, 1000)
    assert draft is not None and draft.x_px == pytest.approx(2.0) and draft.covariance_px2 is None
    assert proposed_at(proposals, 10_000) is None and proposed_at(proposals, 30_000) is None
