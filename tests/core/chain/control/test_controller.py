import math

import numpy as np
import pytest

from core.chain.control.controller import BuiltInController, ControllerConfig, RacketDecision
from core.chain.control.stroke_solver import is_as_wanted, is_safe, spin_after_bounce
from core.physics import Strokes, TaskConfig
from core.physics.episode import Arrivals, Outcomes
from core.physics.flight import air_from_config
from core.physics.impact import surfaces_from_config
from core.physics.rotation import normals_from_orientations, orientations_from_actions
from core.physics.task import task_profile
from core.simulation.episodes import draw_serves, fly_serves, return_balls
from core.simulation.episodes.racket import RacketConfig, check_target
from core.table import BALL_RADIUS_M, NET_HEIGHT_M

pytestmark = pytest.mark.numeric
BALLS = 60
TARGETS_M = np.random.default_rng(1).uniform((0.45, -0.45), (1.10, 0.45), (BALLS, 2))


def arrivals_of(speed_mps: float, task: TaskConfig) -> Arrivals:
    return fly_serves(draw_serves(speed_mps, BALLS, task, np.random.default_rng(round(speed_mps))), task)


def answer(controller: BuiltInController, arrivals: Arrivals, row: int, *, stage="post", **more) -> RacketDecision:
    state = arrivals.states[row]
    command = controller.decide(arrivals.t_s[row], state[:3], state[3:6], stage=stage, **more)
    assert command is not None
    return command


def play_all(controller: BuiltInController, arrivals: Arrivals) -> tuple[list[RacketDecision], Outcomes]:
    commands = [answer(controller, arrivals, row, target_m=TARGETS_M[row]) for row in range(BALLS)]
    strokes = Strokes(
        np.array([command.target.q_wxyz for command in commands]),
        np.array([command.target.v_mps for command in commands]),
        arrivals.states[:, :3].copy(),
        arrivals.t_s.copy(),
    )
    return commands, return_balls(arrivals, strokes, controller.task)


@pytest.mark.parametrize("speed_mps", [3.0, 4.0, 5.0, 7.0, 9.0])
def test_with_the_true_state_every_serve_is_returned_and_lands_on_its_target(speed_mps: float) -> None:
    controller = BuiltInController()
    _, outcomes = play_all(controller, arrivals_of(speed_mps, controller.task))
    error_m = np.linalg.norm(outcomes.landings_m - TARGETS_M, axis=1)
    assert outcomes.returned.all()
    assert np.median(error_m) < 0.001
    assert error_m.mean() < (0.06 if speed_mps == 3.0 else 0.01), "slow serves arrive low and not all targets are open"


@pytest.mark.parametrize("speed_mps", [5.0, 7.0, 9.0])
def test_with_drag_and_magnus_too(speed_mps: float) -> None:
    controller = BuiltInController(task_profile("real"))
    _, outcomes = play_all(controller, arrivals_of(speed_mps, controller.task))
    error_m = np.linalg.norm(outcomes.landings_m - TARGETS_M, axis=1)
    assert outcomes.returned.mean() >= 0.98
    assert np.median(error_m) < 0.005


def test_told_the_physics_it_plays_real_balls_like_one_that_always_knew_them_and_untold_it_does_not() -> None:
    real = task_profile("real")
    arrivals = arrivals_of(6.0, real)
    errors_m = []
    for controller in (BuiltInController().for_physics(real.physics), BuiltInController()):
        commands = [answer(controller, arrivals, row, target_m=TARGETS_M[row]) for row in range(BALLS)]
        qs, vs = (np.array([getattr(command.target, name) for command in commands]) for name in ("q_wxyz", "v_mps"))
        outcomes = return_balls(arrivals, Strokes(qs, vs, arrivals.states[:, :3].copy(), arrivals.t_s.copy()), real)
        errors_m.append(np.median(np.linalg.norm(outcomes.landings_m - TARGETS_M, axis=1)))
    assert errors_m[0] < 0.005 and errors_m[1] > 0.05


def test_what_is_expected_of_a_stroke_is_what_comes_of_it() -> None:
    controller = BuiltInController()
    commands, outcomes = play_all(controller, arrivals_of(4.0, controller.task))
    expected = np.array([command.landing_m for command in commands])
    np.testing.assert_allclose(outcomes.landings_m, expected, atol=1e-6)
    np.testing.assert_allclose(outcomes.net_z_m, [command.net_z_m for command in commands], atol=1e-6)
    assert (outcomes.net_z_m > NET_HEIGHT_M + BALL_RADIUS_M).all()


@pytest.mark.parametrize("speed_mps", [3.0, 6.0, 9.0])
def test_commands_keep_the_limits_of_angles_speeds_and_the_simulated_racket(speed_mps: float) -> None:
    controller = BuiltInController()
    arrivals = arrivals_of(speed_mps, controller.task)
    config = controller.config
    for row in range(BALLS):
        command = answer(controller, arrivals, row, target_m=TARGETS_M[row])
        assert np.abs(command.action).max() <= 1 + 1e-12
        assert command.action[0] == 0, "turning the face about its normal changes nothing"
        np.testing.assert_allclose(
            command.target.q_wxyz, orientations_from_actions(command.action, controller.task.stroke)
        )
        assert config.slowest_mps - 1e-12 <= command.target.v_mps[0] <= config.fastest_mps + 1e-12
        assert not command.target.v_mps[1:].any()
        check_target(command.target, RacketConfig())


@pytest.mark.parametrize(
    ("p", "v", "row", "limit"),
    [
        ((-1.42, 0.0, 0.1), (-4.0, 0.0, -1.0), 1, -1.0),
        ((-1.42, 0.0, 0.7), (-4.0, 4.0, 0.0), 1, 1.0),
        ((-1.42, 0.0, 0.3), (-4.0, 4.5, 0.0), 2, -1.0),
        ((-1.42, 0.0, 0.3), (-4.0, -4.5, 0.0), 2, 1.0),
    ],
)
def test_a_ball_that_asks_for_more_than_the_face_may_turn_gets_just_that(p, v, row, limit) -> None:
    task = TaskConfig(stroke=type(TaskConfig().stroke)(base_pitch_deg=6.0))
    command = BuiltInController(task).decide(0.5, p, v, stage="post", spin_radps=np.zeros(3))
    assert command is not None
    assert command.action[row] == pytest.approx(limit, abs=1e-9)
    assert np.abs(command.action).max() <= 1 + 1e-9


def test_the_racket_is_no_slower_and_no_faster_than_it_is_told() -> None:
    for config, p, v, speed in (
        (ControllerConfig(slowest_mps=-0.5), (-1.42, 0.0, 0.3), (-9.0, 0.0, 0.0), -0.5),
        (ControllerConfig(fastest_mps=2.0), (-1.42, 0.0, 0.3), (-1.5, 0.0, 2.0), 2.0),
    ):
        free = BuiltInController().decide(0.5, p, v, stage="post", spin_radps=np.zeros(3))
        bound = BuiltInController(config=config).decide(0.5, p, v, stage="post", spin_radps=np.zeros(3))
        assert free is not None and bound is not None
        assert bound.target.v_mps[0] == pytest.approx(speed, abs=1e-9)
        assert abs(free.target.v_mps[0] - speed) > 0.2
        assert bound.landing_m is not None and 0.6 < bound.landing_m[0] < 1.0


def test_the_middle_of_the_face_touches_the_ball_at_the_predicted_place_and_time() -> None:
    controller = BuiltInController()
    arrivals = arrivals_of(5.0, controller.task)
    target = answer(controller, arrivals, 0).target
    ball = target.p_m + BALL_RADIUS_M * normals_from_orientations(target.q_wxyz)
    np.testing.assert_allclose(ball, arrivals.states[0, :3], atol=1e-12)
    assert target.t_s == arrivals.t_s[0]


def test_before_the_bounce_the_racket_only_moves_there() -> None:
    controller = BuiltInController()
    arrivals = arrivals_of(5.0, controller.task)
    early, late = (answer(controller, arrivals, 3, stage=stage) for stage in ("pre", "post"))
    assert not early.action.any() and early.landing_m is None and early.net_z_m is None
    np.testing.assert_allclose(early.target.p_m, late.target.p_m, atol=0.01)
    np.testing.assert_allclose(early.target.v_mps, late.target.v_mps)


def test_told_to_orient_early_the_first_command_is_the_whole_stroke() -> None:
    controller = BuiltInController(config=ControllerConfig(orient_early=True))
    arrivals = arrivals_of(5.0, controller.task)
    early, late = (answer(controller, arrivals, 3, stage=stage) for stage in ("pre", "post"))
    np.testing.assert_array_equal(early.target.q_wxyz, late.target.q_wxyz)
    assert early.stage == "pre" and early.landing_m is not None


@pytest.mark.parametrize("profile", ["paper", "real"])
@pytest.mark.parametrize("speed_mps", [3.0, 5.0, 9.0])
def test_the_spin_that_the_table_gives_is_told_from_the_flight_after_it(profile, speed_mps: float) -> None:
    task = task_profile(profile)
    arrivals = arrivals_of(speed_mps, task)
    table, air = surfaces_from_config(task.physics)[0], air_from_config(task.physics)
    for state in arrivals.states:
        ball = np.concatenate([state[:6], np.zeros(3)])
        for _ in range(2):
            ball[6:] = spin_after_bounce(ball, table, air)
        np.testing.assert_allclose(ball[6:], state[6:], atol=1e-9 if profile == "paper" else 3.0)
    assert np.linalg.norm(arrivals.states[:, 6:], axis=1).min() > 10


def test_a_known_spin_replaces_the_assumed_one() -> None:
    controller = BuiltInController()
    arrivals = arrivals_of(5.0, controller.task)
    assumed = answer(controller, arrivals, 0)
    np.testing.assert_allclose(
        answer(controller, arrivals, 0, spin_radps=arrivals.states[0, 6:]).action, assumed.action
    )
    spinning = answer(controller, arrivals, 0, spin_radps=[0.0, -150.0, 0.0])
    assert np.abs(spinning.action - assumed.action).max() > 0.05


def test_a_base_orientation_shifts_the_action_but_not_the_face() -> None:
    flat, open_ = TaskConfig(), TaskConfig()
    open_ = TaskConfig(stroke=type(open_.stroke)(base_pitch_deg=4.0))
    arrivals = arrivals_of(6.0, flat)
    normals = [
        normals_from_orientations(answer(BuiltInController(task), arrivals, 5).target.q_wxyz) for task in (flat, open_)
    ]
    np.testing.assert_allclose(normals[0], normals[1], atol=1e-4)
    actions = [answer(BuiltInController(task), arrivals, 5).action for task in (flat, open_)]
    assert actions[1][1] - actions[0][1] == pytest.approx(4.0 / 15.0, abs=1e-3)


@pytest.mark.parametrize(
    ("t_c", "p_c", "v_c"),
    [
        (math.nan, (-1.42, 0, 0.3), (-4, 0, 0)),
        (0.5, (-1.42, math.nan, 0.3), (-4, 0, 0)),
        (0.5, (-1.42, 0, 0.3), (4, 0, 0)),
    ],
)
def test_a_ball_that_does_not_come_gets_no_command(t_c, p_c, v_c) -> None:
    assert BuiltInController().decide(t_c, p_c, v_c, stage="post") is None


def test_a_ball_far_below_the_table_gets_none_or_the_best_that_is_left() -> None:
    command = BuiltInController().decide(0.5, (-1.42, 0.0, -0.4), (-2.0, 0.0, -3.0), stage="post")
    assert command is None or command.net_z_m is not None


def test_a_base_orientation_costs_the_solver_nothing() -> None:
    """It starts from the same face, however its angles are counted."""
    arrivals = arrivals_of(6.0, TaskConfig())
    for state in arrivals.states[:10]:
        flat, tilted = (
            BuiltInController(TaskConfig(stroke=type(TaskConfig().stroke)(base_pitch_deg=pitch))).solve(
                np.ascontiguousarray(state), (0.8, 0.1)
            )
            for pitch in (0.0, 6.0)
        )
        assert flat is not None and tilted is not None and flat.evaluations == tilted.evaluations
        assert tilted.speed_mps == pytest.approx(flat.speed_mps, abs=1e-3)


@pytest.mark.parametrize(
    ("landing", "net_z", "safe"),
    [
        ((0.09, 0.0), 0.25, True),
        ((0.07, 0.0), 0.25, False),
        ((1.28, 0.0), 0.25, True),
        ((1.30, 0.0), 0.25, False),
        ((0.7, -0.67), 0.25, True),
        ((0.7, 0.69), 0.25, False),
        ((0.7, 0.0), 0.2035, True),
        ((0.7, 0.0), 0.2015, False),
    ],
)
def test_a_safe_stroke_keeps_eight_centimetres_from_the_edges_and_three_from_the_net(landing, net_z, safe) -> None:
    """The far half ends at 1.37 and 0.7625 m; a ball's centre over the cord is at 0.1725 m."""
    assert is_safe(np.array([*landing, net_z])) == safe


def test_a_stroke_is_as_wanted_two_centimetres_round_its_landing_point_and_clear_of_the_net() -> None:
    wanted = np.array([0.8, 0.1, 0.35])
    for reached, as_wanted in (
        ((0.8, 0.1, 0.35), True),
        ((0.813, 0.114, 0.35), True),  # 19 mm
        ((0.815, 0.115, 0.35), False),  # 21 mm
        ((0.8, 0.1, 0.2035), True),  # lower than wanted, but clear
        ((0.8, 0.1, 0.2015), False),
    ):
        assert is_as_wanted(np.array(reached), wanted) == as_wanted
    assert is_as_wanted(np.array([0.8, 0.1, 0.19]), np.array([0.8, 0.1, 0.185])), "no more than was wanted"
