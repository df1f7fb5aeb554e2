"""Which balls of a live rally are counted."""

import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from app.modes.watch.status import moment_html
from app.shared.live_rally import BEHIND_US, LiveRally, was_followed
from core.history.rally_history import RallyHistory
from core.history.record_live import LiveRows
from core.history.seen_outcomes import ReturnCounts
from core.live.link import messages as m
from core.live.stream_watch import StreamWatch
from core.physics.episode import Case

NAN = float("nan")
MISSED = m.OutcomeNotice(
    session="now", seq=2, t_us=2_700_000, serve_us=2_000_000, speed_mps=5.0, case=Case.MISSED, arrival=6 * (NAN,),
    q_wxyz=4 * (NAN,), landing_m=3 * (NAN,), landing_v_mps=3 * (NAN,), net_z_m=NAN,
)  # fmt: skip
SERVE = m.ServeNotice(
    session="now", seq=1, t_us=2_000_000, speed_mps=5.0, p_m=(1.4, 0.0, 0.3), v_mps=(-5.0, 0.0, 1.0),
    spin_radps=(0.0, 0.0, 0.0),
)  # fmt: skip


@pytest.mark.parametrize(
    ("session", "t_us", "state", "counts"),
    [
        ("now", 1_990_000, "a step", True),
        ("now", SERVE.t_us - BEHIND_US - 1, "a step", False),
        ("now", 1_990_000, None, False),
        ("before", 1_990_000, "a step", False),
    ],
    ids=["followed", "far behind", "still compiling", "of another session"],
)
def test_a_ball_counts_only_if_the_player_followed_when_it_was_served(session, t_us, state, counts) -> None:
    snapshot = SimpleNamespace(session=session, t_us=t_us, state=state)
    assert was_followed(SERVE, snapshot) == counts  # type: ignore[arg-type]


def followed_rally() -> SimpleNamespace:
    """A rally whose player follows."""
    player = SimpleNamespace(
        controller=SimpleNamespace(name="built-in"),
        snapshot=SimpleNamespace(session="now", t_us=SERVE.t_us, state="a step"),
        wake=lambda: None,
    )
    return SimpleNamespace(
        player=player,
        returns=ReturnCounts(),
        history=RallyHistory(),
        rows=LiveRows(),
        watch=StreamWatch(),
        robot=None,
        learning=SimpleNamespace(on=False),
        _source_with_robot=SimpleNamespace(listen=lambda listening: None),
        _scene="ball",
        _recorder=None,
        _keeping=threading.Lock(),
        _keepers=0,
        _watched=True,
        _awake=True,
    )


def test_a_ball_that_was_served_before_the_chain_followed_is_no_miss() -> None:
    """A cold start: the first ball flies while the detector is still being compiled."""
    rally = followed_rally()
    rally.player.snapshot = SimpleNamespace(session="now", t_us=0, state=None)

    def shown() -> str:
        return moment_html(rally.history.at(3_000_000, {}), 15.0, 1.0)

    for notice in (SERVE, MISSED):
        LiveRally.on_notice(rally, notice)  # type: ignore[arg-type]
    assert "not followed, or something changed during it: not counted" in shown()
    assert "missed" not in shown() and "of 1 returned" not in shown() and not rally.returns.rates()

    rally.player.snapshot = SimpleNamespace(session="now", t_us=SERVE.t_us, state="a step")
    for notice in (SERVE, MISSED):
        LiveRally.on_notice(rally, notice)  # type: ignore[arg-type]
    assert "missed" in shown() and "0 of 1 returned" in shown()
    assert [(one.balls, one.returned) for one in rally.returns.rates()] == [(1, 0)]


def test_a_recording_that_ends_while_it_is_looked_at_harms_nobody() -> None:
    class Ending:
        """A rally whose recording is ended by another thread after the first look at it."""

        looks = iter((SimpleNamespace(path=Path("rally.h5")), None))

        @property
        def _recorder(self) -> SimpleNamespace | None:
            return next(self.looks)

    assert vars(LiveRally)["recorded"].fget(Ending()) == Path("rally.h5")


def test_a_ball_whose_serve_nobody_heard_is_no_miss_either() -> None:
    """The serve came while the source rested; the ball before it was followed."""
    rally = followed_rally()
    for notice in (SERVE, MISSED, MISSED):
        LiveRally.on_notice(rally, notice)  # type: ignore[arg-type]
    assert [one.counted for one in rally.history.outcomes_between(0, 3_000_000)] == [True, False]
    assert [one.balls for one in rally.returns.rates()] == [1]


def test_a_ball_during_which_the_source_rested_is_no_miss() -> None:
    rally = followed_rally()
    LiveRally.on_notice(rally, SERVE)  # type: ignore[arg-type]
    for watched in (False, True):
        rally._watched = watched
        LiveRally._listen(rally)  # type: ignore[arg-type]
    LiveRally.on_notice(rally, MISSED)  # type: ignore[arg-type]
    assert [one.counted for one in rally.history.outcomes_between(0, 3_000_000)] == [False]
    assert not rally.returns.rates()
