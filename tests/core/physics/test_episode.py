"""What came of strokes, read from their arrays."""

from __future__ import annotations

import numpy as np

from core.physics import contact
from core.physics.episode import CASE_OF_CONTACT, Case, Outcomes


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
