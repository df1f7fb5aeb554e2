"""What a server says of a block, number by number."""

import numpy as np
import pytest

from core.live.link.messages import BounceNotice, HitNotice
from core.live.link.published import contact_notice, outcome_notice, serve_notice
from core.live.worlds.world import ClassifiedBall, RacketContact
from core.physics.episode import Case
from core.simulation.episodes.ball_outcome import BallOutcome, RallyEvent

AFTER, BEFORE = np.arange(1.0, 10.0), np.arange(11.0, 20.0)
Q = np.array([0.5, -0.5, 0.5, -0.5])


def test_a_serve_is_told_with_its_whole_state_and_its_speed() -> None:
    told = serve_notice(RallyEvent("serve", 1.2345674, AFTER, AFTER), "s", 7)
    assert (told.session, told.seq, told.t_us) == ("s", 7, 1_234_567)
    assert (told.p_m, told.v_mps, told.spin_radps) == ((1, 2, 3), (4, 5, 6), (7, 8, 9))
    assert told.speed_mps == pytest.approx(np.sqrt(16 + 25 + 36))


def test_a_bounce_is_told_as_it_leaves_and_a_hit_with_how_it_came() -> None:
    bounce = contact_notice(RacketContact(RallyEvent("bounce", 0.5, AFTER, BEFORE), Q), "s", 8)
    assert isinstance(bounce, BounceNotice)
    assert (bounce.seq, bounce.t_us, bounce.p_m, bounce.v_mps) == (8, 500_000, (1, 2, 3), (4, 5, 6))
    hit = contact_notice(RacketContact(RallyEvent("hit", 0.5, AFTER, BEFORE), Q), "s", 9)
    assert isinstance(hit, HitNotice)
    assert (hit.seq, hit.t_us, hit.p_m, hit.v_mps) == (9, 500_000, (1, 2, 3), (4, 5, 6))
    assert (hit.v_before_mps, hit.q_wxyz) == ((14, 15, 16), tuple(Q))


def test_an_outcome_is_told_with_the_serve_that_it_belongs_to() -> None:
    outcome = BallOutcome(Case.OUT, 2.5, np.array([1.0, 2.0, 0.02]), np.array([3.0, 4.0, -5.0]), 0.33)
    told = outcome_notice(ClassifiedBall(outcome, RallyEvent("serve", 2.0, AFTER, AFTER), np.arange(6.0), Q), "s", 10)
    assert (told.t_us, told.serve_us, told.case, told.net_z_m) == (2_500_000, 2_000_000, Case.OUT, 0.33)
    assert (told.landing_m, told.landing_v_mps) == ((1.0, 2.0, 0.02), (3.0, 4.0, -5.0))
    assert (told.arrival, told.q_wxyz) == ((0, 1, 2, 3, 4, 5), tuple(Q))
    assert told.speed_mps == pytest.approx(np.sqrt(77))
