import math
from dataclasses import replace

import numpy as np
import pytest

from core.chain.control.controller import BuiltInController, ControllerConfig
from core.chain.control.step_test import RacketStep, command_latency
from core.errors import ConfigError
from core.physics.task import TaskConfig

pytestmark = pytest.mark.numeric


def step(late_s: float, *, noise_m: float = 0.0, seed: int = 0) -> RacketStep:
    """A smooth motion of 5 cm that was to take a quarter of a second, reported every 2 ms."""
    t_s = 3.0 + np.arange(0, 0.5, 0.002)
    share = np.clip((t_s - 3.0 - late_s) / 0.25, 0, 1)
    ps = np.outer(3 * share**2 - 2 * share**3, [0.0, 0.05, 0.0]) + np.array([-1.6, 0.0, 0.25])
    ps += np.random.default_rng(seed).normal(0, noise_m, ps.shape)
    start = np.array([-1.6, 0.0, 0.25])
    return RacketStep(3.0, 3.25, start, start + np.array([0.0, 0.05, 0.0]), t_s, ps)


@pytest.mark.parametrize("late_s", [0.0, 0.010, 0.0437, 0.120])
def test_a_step_tells_by_how_much_the_racket_is_late(late_s: float) -> None:
    assert step(late_s).late_s == pytest.approx(late_s, abs=1e-4)
    assert step(late_s, noise_m=0.0002).late_s == pytest.approx(late_s, abs=0.002)


def test_some_steps_tell_mean_and_jitter() -> None:
    late = np.random.default_rng(3).uniform(0.035, 0.045, 12)
    found = command_latency([step(one) for one in late])
    assert found.mean_s == pytest.approx(late.mean(), abs=2e-4) and found.steps == 12
    assert found.jitter_s == pytest.approx(late.std(ddof=1), abs=2e-4)
    assert found.sigma_s == pytest.approx(found.jitter_s / math.sqrt(12))


def test_a_racket_that_does_not_move_is_an_error() -> None:
    dead = replace(step(0.0), ps_m=np.tile([-1.6, 0.0, 0.25], (250, 1)))
    assert math.isnan(dead.late_s)
    with pytest.raises(ConfigError, match="did not move"):
        command_latency([dead] * 5 + [step(0.01)] * 2)
    with pytest.raises(ConfigError, match="without a length"):
        _ = replace(dead, to_m=dead.from_m).late_s


def test_the_controller_leads_by_so_much() -> None:
    ball = (1.5, [-1.42, 0.1, 0.25], [-4.0, 0.0, 1.0])
    plain = BuiltInController(TaskConfig()).decide(*ball, stage="post")
    led = BuiltInController(TaskConfig(), ControllerConfig(lead_ms=40.0)).decide(*ball, stage="post")
    assert plain is not None and led is not None
    assert plain.target.t_s - led.target.t_s == pytest.approx(0.040)
    np.testing.assert_array_equal(plain.target.p_m, led.target.p_m)
    np.testing.assert_array_equal(plain.target.q_wxyz, led.target.q_wxyz)
