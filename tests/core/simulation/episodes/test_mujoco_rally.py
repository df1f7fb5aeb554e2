"""The stepped rally in MuJoCo against the closed form, and as a rally."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from core.errors import ConfigError
from core.physics import Case, strokes_from_actions
from core.physics.episode import Strokes
from core.physics.flight import air_from_config, fly
from core.physics.task import TaskConfig, task_profile
from core.simulation.episodes import ball_outcome, draw_serves, fly_serves, simulate_episodes
from core.simulation.episodes.ball_outcome import BallOutcome, RallyClassifier, RallyEvent
from core.simulation.episodes.episode_path import trace_episode
from core.simulation.episodes.mujoco_rally import MujocoRally, simulate_episodes_mujoco
from core.simulation.episodes.racket import target_for_ball

pytestmark = pytest.mark.numeric
PAPER = task_profile("paper")
REAL = task_profile("real")


@pytest.mark.parametrize("task", [PAPER, REAL], ids=["paper", "real"])
@pytest.mark.parametrize(("dt_s", "count"), [(0.01, 12), (0.001, 3)])
@pytest.mark.parametrize("aimed", [False, True], ids=["in plane", "aimed"])
def test_mujoco_and_the_closed_form_agree_on_case_landing_net_height_and_time(
    task: TaskConfig, dt_s: float, count: int, aimed: bool
) -> None:
    rng = np.random.default_rng(5)
    for speed in (3.0, 6.0, 9.0):
        serves = draw_serves(speed, count, task, rng)
        arrivals = fly_serves(serves, task)
        strokes = strokes_from_actions(rng.uniform(-1, 1, (count, 3)), task.stroke.racket_speed.at(speed), task.stroke)
        if aimed:
            noisy_p = arrivals.states[:, :3] + rng.normal(0, 0.03, (count, 3))
            noisy_t = arrivals.t_s + rng.normal(0, 0.005, count)
            strokes = Strokes(strokes.qs_wxyz, strokes.vs_mps, noisy_p, noisy_t)
        ours = simulate_episodes(serves, strokes, task)
        theirs = simulate_episodes_mujoco(serves, strokes, task, dt_s=dt_s)
        assert (ours.case == theirs.case).all()
        assert theirs.landing_states[:, :3] == pytest.approx(ours.landing_states[:, :3], abs=1e-4, nan_ok=True)
        assert theirs.net_z_m == pytest.approx(ours.net_z_m, abs=1e-4, nan_ok=True)
        assert theirs.contact_t_s == pytest.approx(ours.contact_t_s, abs=1e-5, nan_ok=True)


def test_mujoco_s_own_air_is_our_air() -> None:
    state = np.array([0.9, 0.1, 0.5, -5.0, 1.0, 2.0, 30.0, -150.0, 80.0])
    rally = MujocoRally(REAL, dt_s=0.01)
    rally.serve(state[:3], state[3:6], state[6:9])
    rally.step(0.3)
    expected = state.copy()
    for _ in range(300):
        fly(expected, 0.001, air_from_config(REAL.physics), expected)
    assert rally.ball == pytest.approx(expected, abs=1e-6)


def play(
    rally: MujocoRally, duration_s: float, dt_s: float | None = None
) -> tuple[list[RallyEvent], list[BallOutcome]]:
    judge = RallyClassifier(rally.task)
    events: list[RallyEvent] = []
    decided: list[BallOutcome] = []
    while rally.time_s < duration_s - 1e-9:
        new = rally.step(min(rally.dt_s, duration_s - rally.time_s))
        events.extend(new)
        decided.extend(judge.feed([e for e in new if e.kind != "serve"]))
    return events, decided


def served_and_aimed(seed: int, dt_s: float) -> tuple[MujocoRally, RallyClassifier, Strokes, np.ndarray]:
    rng = np.random.default_rng(seed)
    serves = draw_serves(5.0, 1, PAPER, rng)
    arrivals = fly_serves(serves, PAPER)
    strokes = strokes_from_actions(rng.uniform(-1, 1, (1, 3)), 1.0, PAPER.stroke)
    rally = MujocoRally(PAPER, dt_s=dt_s)
    judge = RallyClassifier(PAPER)
    judge.feed([rally.serve(serves.ps_m[0], serves.vs_mps[0])])
    target = target_for_ball(arrivals.states[0, :3], strokes.qs_wxyz[0], strokes.vs_mps[0], float(arrivals.t_s[0]))
    rally.aim_racket(target)
    return rally, judge, strokes, serves.states()


@pytest.mark.parametrize("dt_s", [0.01, 0.004])
def test_a_live_rally_with_a_bounded_racket_ends_like_the_one_step_episode(dt_s: float) -> None:
    for seed in range(6):
        rally, judge, strokes, _ = served_and_aimed(seed, dt_s)
        serves = draw_serves(5.0, 1, PAPER, np.random.default_rng(seed))
        expected = simulate_episodes(serves, strokes, PAPER)
        path = trace_episode(serves, strokes, PAPER)
        decided: list[BallOutcome] = []
        kinds = ["serve"]
        while rally.playing and rally.time_s < 3:
            events = rally.step()
            kinds += [e.kind for e in events if e.kind in ("bounce", "hit", "net", "end", "floor")]
            decided += judge.feed(events)
            if rally.time_s < path.end_s:
                assert rally.ball[:3] == pytest.approx(path.at(rally.time_s)[:3], abs=1e-5)
        assert [int(outcome.case) for outcome in decided] == [int(expected.case[0])]
        assert decided[0].landing_m == pytest.approx(expected.landing_states[0, :3], abs=1e-6)
        assert decided[0].net_z_m == pytest.approx(expected.net_z_m[0], abs=1e-6)
        assert kinds[:3] == ["serve", "bounce", "hit"]


def test_the_step_length_changes_nothing() -> None:
    ends = []
    for dt_s in (0.01, 0.0037, 0.001):
        rally, _, _, _ = served_and_aimed(3, dt_s)
        events, _ = play(rally, 0.9)
        ends.append((rally.ball, [(e.kind, round(e.t_s, 9)) for e in events if e.kind in ("bounce", "hit")]))
    for ball, events in ends[1:]:
        assert ball == pytest.approx(ends[0][0], abs=1e-8)
        assert events == ends[0][1]


def test_the_same_rally_twice_is_the_same_to_the_bit() -> None:
    balls = []
    for _ in range(2):
        rally, _, _, _ = served_and_aimed(2, 0.01)
        play(rally, 1.5)
        balls.append(rally.ball)
    assert (balls[0] == balls[1]).all()


def test_a_ball_that_nobody_meets_is_missed_once_and_the_rally_waits_for_a_serve() -> None:
    rally, judge, _, _ = served_and_aimed(1, 0.01)
    rally.aim_racket(None)
    decided = [outcome for _ in range(300) for outcome in judge.feed(rally.step())]
    assert [outcome.case for outcome in decided] == [Case.MISSED]
    assert not rally.playing
    before = rally.ball
    assert rally.step(0.5) == ()
    assert (rally.ball == before).all()
    assert rally.time_s == pytest.approx(3.5)


def test_passages_are_told_without_changing_the_flight() -> None:
    rally, _, _, _ = served_and_aimed(1, 0.01)
    rally.aim_racket(None)
    rally.coast_racket(rally.racket)
    events, _ = play(rally, 1.0)
    kinds = [event.kind for event in events]
    for passage in ("net_plane", "top", "hit_plane"):
        assert passage in kinds
    crossing = next(event for event in events if event.kind == "hit_plane")
    arrivals = fly_serves(draw_serves(5.0, 1, PAPER, np.random.default_rng(1)), PAPER)
    assert crossing.t_s == pytest.approx(arrivals.t_s[0])
    assert crossing.state == pytest.approx(arrivals.states[0], abs=1e-9)


def test_one_long_step_is_the_same_as_many_short_ones() -> None:
    """A whole second is more than fifty steps of the rally's own; only impacts in a row stop a ball."""
    many, once = (served_and_aimed(2, 0.01)[0] for _ in range(2))
    told = [(event.kind, event.t_s) for _ in range(100) for event in many.step()]
    at_once = [(event.kind, event.t_s) for event in once.step(1.0)]
    assert once.playing and once.time_s == pytest.approx(1.0)
    assert once.ball == pytest.approx(many.ball, abs=1e-9)
    assert [kind for kind, _ in at_once] == [kind for kind, _ in told]
    assert [t for _, t in at_once] == pytest.approx([t for _, t in told], abs=1e-9)


def test_impossible_serves_and_steps_are_refused() -> None:
    rally = MujocoRally(PAPER)
    for p, v in (
        ((0, 0, 0.01), (0, 0, 0)),
        ((9, 0, 1), (0, 0, 0)),
        ((1, 0, 1), (90, 0, 0)),
        ((1, 0, np.nan), (0, 0, 0)),
    ):
        with pytest.raises(ConfigError):
            rally.serve(p, v)
    with pytest.raises(ConfigError, match="time step"):
        MujocoRally(PAPER, dt_s=0.5)


def test_the_numba_physics_does_not_load_mujoco() -> None:
    code = (
        "import sys, core.physics, core.simulation.episodes.episode_path, core.simulation.episodes.racket, "
        "core.simulation.episodes.ball_outcome; sys.exit('mujoco' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_page_names_all_that_is_left_to_mujoco() -> None:
    source = Path(inspect.getfile(MujocoRally)).read_text()
    page = (Path(__file__).parents[4] / "docs" / "how" / "physics.md").read_text()
    section = page.split("## What does MuJoCo compute in the live rally?")[1]
    (sentence,) = (line for line in section.splitlines() if "All that `mujoco_rally.py` calls of MuJoCo" in line)
    called = {
        node.attr
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "mj"
    }
    assert set(re.findall(r"\b[Mm]j\w+", sentence)) == called
    rows = [line.split("|")[3] for line in section.splitlines() if line.startswith("|")]
    named = set(re.findall(r"`(\w+)`", "".join(rows)))
    assert len(named) > 8 and named <= {*re.findall(r"\w+", source), *dir(ball_outcome), "draw_serves"}


def test_mujoco_finds_no_contact_and_its_racket_is_where_ours_is() -> None:
    rally, _, _, _ = served_and_aimed(0, 0.002)
    assert not rally.model.geom_contype.any() and not rally.model.geom_conaffinity.any() and rally.model.nu == 0
    while rally.playing:
        rally.step()
        assert rally.data.ncon == 0
        np.testing.assert_array_equal(rally.data.qpos[7:14], [*rally.racket.p_m, *rally.racket.q_wxyz])
