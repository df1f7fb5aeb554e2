"""The ONNX file, run by onnxruntime, answers as the policy does."""

import json
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

from app.cli import main
from app.export.onnx_actor import actor_model
from core.learning.agents.policy import Policy
from core.learning.config import RunConfig
from core.learning.runs.run_files import load_policy

RUNS = Path(__file__).parents[2] / "fixtures" / "runs"
LIMIT_RAD = np.pi / 12


def observations(count: int = 1000) -> tuple[np.ndarray, np.ndarray]:
    """States around those of serves of 3 to 9 m/s, a hundred of them far out, and goals on the table."""
    rng = np.random.default_rng(0)
    spread = np.array([0.1, 0.3, 0.2, 3.0, 0.6, 1.0]) * np.where(np.arange(count) < 100, 30.0, 1.0)[:, None]
    states = np.array([-1.42, 0.0, 0.24, -5.0, 0.0, 0.9]) + spread * rng.normal(size=(count, 6))
    goals = rng.uniform((0.0, -0.76), (1.37, 0.76), (count, 2))
    return states.astype(np.float32), goals.astype(np.float32)


def answers(model: str | bytes, states: np.ndarray, goals: np.ndarray) -> np.ndarray:
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    assert [(i.name, i.shape) for i in session.get_inputs()] == [("state", ["N", 6]), ("goal", ["N", 2])]
    assert [(o.name, o.shape) for o in session.get_outputs()] == [("angles_rad", ["N", 3])]
    return session.run(None, {"state": states, "goal": goals})[0]


@pytest.mark.parametrize("best", [False, True])
def test_the_file_of_a_run_answers_as_its_policy_does(best: bool, tmp_path: Path, capsys) -> None:
    path = tmp_path / "actor.onnx"
    options = ["--onnx", str(path), "--seed", "1", "--json", *(["--best"] if best else [])]
    assert main(["export", str(RUNS / "ddpg-0.1"), *options]) == 0
    assert json.loads(capsys.readouterr().out)["files"][0]["path"] == str(path)
    states, goals = observations()
    policy = load_policy(RUNS / "ddpg-0.1", 1, "best" if best else "last")
    expected = LIMIT_RAD * policy(states, np.zeros(len(states)), goals)
    assert np.abs(expected).max() > 0.01
    np.testing.assert_allclose(answers(str(path), states, goals), expected, atol=1e-5)
    about = onnxruntime.InferenceSession(str(path)).get_modelmeta().custom_metadata_map
    assert "m/s" in about["state"] and "rad" in about["angles_rad"] and about["agent"] == "ddpg"
    speeds = json.loads(about["racket_speed"])
    speed = np.interp(-states[500, 3], speeds["incoming_mps"], speeds["racket_mps"])
    assert speed == pytest.approx(policy.racket_speed_mps(states[500]))


@pytest.mark.parametrize(("hidden", "output"), [("relu", "tanh"), ("tanh", "clip")])
def test_large_networks_of_any_of_our_agents_answer_the_same(hidden, output) -> None:
    rng = np.random.default_rng(1)
    sizes = ((8, 64), (64, 64), (64, 3))
    layers = tuple(
        (rng.normal(0, n[0] ** -0.5, n).astype(np.float32), rng.normal(0, 0.1, n[1]).astype(np.float32)) for n in sizes
    )
    policy = Policy(layers, hidden, output, False, np.ones(1, np.float32), np.ones(1, np.float32))
    states, goals = observations()
    got = answers(actor_model(policy, RunConfig()).SerializeToString(), states, goals)
    expected = LIMIT_RAD * policy(states, np.zeros(len(states)), goals)
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(got, expected, atol=1e-5)


def test_what_cannot_be_an_actor_of_state_and_goal_gets_one_clear_line(tmp_path: Path, capsys) -> None:
    path = tmp_path / "actor.onnx"
    for source, told in ((RUNS / "landing-model-0.1", "state and goal alone"), (tmp_path, "")):
        assert main(["export", str(source), "--onnx", str(path)]) == 2
        error = capsys.readouterr().err
        assert told in error and len(error.strip().splitlines()) == 1
    assert main(["export", str(RUNS / "ddpg-0.1"), "--onnx", str(path), "--seed", "7"]) == 2
    assert "cannot read the policy" in capsys.readouterr().err
    assert not path.exists()
