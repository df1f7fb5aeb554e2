"""Which balls of a live rally are counted."""

from types import SimpleNamespace

import pytest

from app.shared.live_rally import BEHIND_US, was_followed
from core.live.link import messages as m

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
