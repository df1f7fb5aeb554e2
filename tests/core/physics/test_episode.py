"""What came of strokes, read from their arrays."""

from __future__ import annotations

import numpy as np

from core.physics import contact
from core.physics.episode import CASE_OF_CONTACT, Case, Outcomes, strokes_from_actions
from core.physics.rotation import orientations_from_actions
from core.physics.task import StrokeConfig


def test_landings_are_the_places_in_the_plane_of_the_landing_states() -> None:
    states, times = np.arange(18.0).reshape(2, 9), np.zeros(2)
    cases = np.array([Case.RETURNED, Case.MISSED], np.int8)
    outcomes = Outcomes(cases, times, states, times, states + 100, times, times, states)
    assert outcomes.landings_m.tolist() == [[100, 101], [109, 110]] and outcomes.returned.tolist() == [True, False]


def test_each_thing_that_the_ball_may_touch_first_has_its_case() -> None:
    for case, touched in (
        (Case.RETURNED, [contact.FAR_TOP]),
        (Case.OWN_HALF, [contact.OWN_TOP, contact.OWN_END]),
        (Case.NET, [contact.NET]),
        (Case.OUT, [contact.FLOOR, contact.FAR_END, contact.NOTHING]),
    ):
        assert CASE_OF_CONTACT[touched].tolist() == [case] * len(touched)


def test_a_stroke_has_the_orientation_of_its_action_and_moves_along_x_at_its_own_speed() -> None:
    actions, speeds_mps = np.array([[0, 0, 0], [1, -0.5, 0.25]]), np.array([1.5, -0.5])
    strokes = strokes_from_actions(actions, speeds_mps, StrokeConfig())
    assert (strokes.qs_wxyz == orientations_from_actions(actions, StrokeConfig())).all()
    assert strokes.vs_mps.tolist() == [[1.5, 0, 0], [-0.5, 0, 0]] and strokes.aim_ps_m is None
