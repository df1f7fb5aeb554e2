"""`rallyscope train` and `evaluate` as a user types them."""

import dataclasses
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from core.cameras import Camera, stereo_preset
from core.config import save_config
from core.events import SensorSize
from core.learning.config import EnvironmentConfig, default_run
from core.learning.runs.named_runs import NAMED_RUNS
from core.learning.runs.run_files import create_run, load_policy, read_lines, read_run, seed_files
from core.learning.task.environment import BALLS, draw_serve_batch
from core.live.link.guard import ServerKeys, make_keys, read_server_keys
from core.live.link.server import ServerConfig, SimulationServer
from tests.core.learning.task.test_recorded_balls import write_states
from tests.simulation_servers import serving

SHORT = ["--agent", "landing-model", "--state-source", "truth"]


def test_a_run_is_trained_refused_twice_and_evaluated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = str(tmp_path / "run")
    options = ["--speeds", "5,6", "--episodes", "40,20", "--seeds", "2", "--out", run]
    assert main(["train", *SHORT, *options, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["state"] == "finished" and [seed["seed"] for seed in report["seeds"]] == [0, 1]
    assert main(["train", *SHORT, *options]) == 2
    assert "there is a run already" in capsys.readouterr().err
    assert main(["train", "--resume", "--out", run]) == 0
    assert "finished" in capsys.readouterr().out
    assert main(["evaluate", run, "--balls", "50", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["speed_mps"], row["balls"], row["seeds"]) for row in rows] == [(5.0, 50, 2), (6.0, 50, 2)]
    for row in rows:
        assert 0 <= row["returned"] <= 1
        assert set(row["error_mm"]) == set(row["error_returned_mm"]) == {"mean", "std", "median", "p95"}
        assert set(row["baselines"]) == {"zero", "random", "constant_centre", "oracle"}
        assert row["baselines"]["oracle"]["error_mm"] < row["error_mm"]["mean"]
    assert main(["evaluate", run, "--balls", "20"]) == 0
    assert "constant centre" in capsys.readouterr().out


def test_a_run_in_mujoco_is_evaluated_there_and_in_closed_form(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, file = str(tmp_path / "run"), tmp_path / "few.toml"
    save_config(dataclasses.replace(default_run("landing-model"), evaluation_balls=10), file)
    options = ["--config", str(file), "--speeds", "5", "--episodes", "12", "--simulator", "mujoco", "--out", run]
    assert main(["train", *options, "--source", "tcp://127.0.0.1:1"]) == 2
    assert "a server plays the strokes itself" in capsys.readouterr().err
    assert main(["train", *options]) == 0
    assert read_run(Path(run)).environment.engine == "mujoco"
    rows = []
    for simulator in ([], ["--simulator", "mujoco"], ["--simulator", "closed-form"]):
        capsys.readouterr()
        assert main(["evaluate", run, "--json", *simulator]) == 0
        rows += json.loads(capsys.readouterr().out)
    here, same, closed = (row["error_mm"]["mean"] for row in rows)
    assert here == same == pytest.approx(closed, abs=1e-3)
    assert here != closed, "other arithmetic: a flag without effect would give the same digits"


def test_a_preset_is_trained_as_other_options_change_it(tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert main(["train", "--preset", "placing", "--episodes", "2", "--out", str(run)]) == 0
    placing = NAMED_RUNS["placing"]
    stages = dataclasses.replace(placing.curriculum, episodes=(2,))
    assert read_run(run) == dataclasses.replace(placing, curriculum=stages)


def test_a_policy_is_trained_and_evaluated_where_the_world_differs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, file = str(tmp_path / "run"), tmp_path / "few.toml"
    save_config(dataclasses.replace(default_run("landing-model"), evaluation_balls=10), file)
    options = ["--config", str(file), "--speeds", "5", "--episodes", "12", "--out", run]
    assert main(["train", *options, "--randomise", "physics, calibration", "--racket", "uncertain"]) == 0
    environment = read_run(Path(run)).environment
    assert environment.randomise.names == ("physics", "calibration") and environment.racket == "uncertain"
    line = read_lines(seed_files(Path(run), 0).metrics)[0][0]
    assert len(line["constants"]) == 5 and len(line["racket_errors"]) == 4  # type: ignore[arg-type]
    errors = []
    home = ["--randomise", "none", "--racket", "table"]
    for asked in ([], ["--randomise", "physics,calibration", "--racket", "uncertain"], home, ["--randomise", "rubber"]):
        capsys.readouterr()
        assert main(["evaluate", run, "--json", *asked]) == 0
        errors.append(json.loads(capsys.readouterr().out)[0]["error_mm"]["mean"])
    assert errors[0] == errors[1] and len(set(errors)) == 3


def test_a_policy_that_chooses_the_speed_is_not_evaluated_with_another_racket(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = default_run("landing-model")
    environment = dataclasses.replace(config.environment, racket="chosen")
    create_run(tmp_path / "run", dataclasses.replace(config, environment=environment))
    assert main(["evaluate", str(tmp_path / "run"), "--racket", "uncertain"]) == 2
    assert "the policy chooses the racket's speed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--speeds", "3,x"], "numbers between commas"),
        (["--speeds", "2"], "3 to 9 m/s"),
        (["--speeds", "3,5,7", "--episodes", "10,20"], "one number of episodes per speed"),
        (["--episodes", "0"], "whole numbers above 0"),
        (["--agent", "dqn"], "invalid choice"),
        (["--source", "http://x"], "tcp://HOST:PORT"),
        (["--source", "tcp://127.0.0.1:9", "--state-source", "events"], "without --source"),
        (["--source", "tcp://192.0.2.1:5555"], "needs keys"),
        (["--source", "tcp://127.0.0.1:9", "--keys", "no-such-folder"], "no-such-folder"),
        (["--keys", "no-such-folder"], "keys without a source"),
        (["--source", "tcp://127.0.0.1:9", "--jobs", "2"], "one seed at a time"),
        (["--cluster", "tcp://192.0.2.1:8786"], "needs certificates"),
        (["--outcomes", "events", "--state-source", "truth"], "need states that they see"),
        (["--resume", "--seeds", "3"], "keeps its settings"),
        (["--resume"], "not a training run"),
        (["--config", "nowhere.toml"], "cannot read the config"),
        (["--state", "spin", "--state-source", "predicted"], "tell no spin"),
        (["--balls", "nowhere.json"], "no recorded balls"),
        (["--racket", "chosen"], "an agent of three angles"),
        (["--preset", "fast"], "invalid choice"),
        (["--preset", "placing", "--agent", "td3"], "a preset is a whole run"),
        (["--preset", "placing", "--config", "nowhere.toml"], "a preset is a whole run"),
        (["--randomise", "physics,wind"], "some of physics, latency, rubber, calibration with commas between, or none"),
        (["--randomise", "rubber", "--state-source", "events"], "cameras see one world"),
        (["--randomise", "rubber", "--source", "tcp://127.0.0.1:9"], "a server plays in one world"),
    ],
)
def test_a_bad_argument_gets_one_clear_line(
    options: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", *options, "--out", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert told in error and len(error.strip().splitlines()) == 1
    assert not (tmp_path / "run" / "config.toml").exists()


def test_evaluate_needs_a_trained_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", str(tmp_path)]) == 2
    assert "not a training run" in capsys.readouterr().err


@contextmanager
def serving_training(keys: ServerKeys | None = None, cameras: dict[str, Camera] | None = None) -> Iterator[str]:
    """A simulation server, with small cameras unless told otherwise; its address."""
    cameras = cameras or stereo_preset("side", SensorSize(320, 240))
    with serving(SimulationServer(ServerConfig(), cameras, "tcp://127.0.0.1:0", keys=keys)) as server:
        yield server.address


@pytest.fixture
def server() -> Iterator[str]:
    with serving_training() as address:
        yield address


@pytest.mark.parametrize("state_source", ["truth", "predicted"])
@pytest.mark.gate
def test_a_simulation_server_gives_the_same_training(state_source: str, server: str, tmp_path: Path) -> None:
    options = ["--agent", "landing-model", "--episodes", "4", "--state-source", state_source, "--out"]
    assert main(["train", *options, str(tmp_path / "home")]) == 0
    assert main(["train", "--source", server, *options, str(tmp_path / "away")]) == 0
    home, away = (read_lines(seed_files(tmp_path / name, 0).metrics)[0] for name in ("home", "away"))
    assert len(home) == len(away) == 4
    for ours, theirs in zip(home, away, strict=True):
        assert ours["case"] == theirs["case"] and ours["serve"] == theirs["serve"]
        assert theirs["landing_m"] == pytest.approx(ours["landing_m"], abs=1e-3)
        assert theirs["action"] == pytest.approx(ours["action"], abs=1e-3)


def test_a_server_with_keys_trains_only_who_has_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for maker in ("lab", "stranger"):
        make_keys(tmp_path / maker)
    options = ["--agent", "landing-model", "--episodes", "2", "--state-source", "truth"]
    with serving_training(read_server_keys(tmp_path / "lab" / "server")) as address:
        ours = ["--source", address, "--keys", str(tmp_path / "lab" / "client")]
        assert main(["train", *ours, *options, "--out", str(tmp_path / "run")]) == 0
        capsys.readouterr()
        for keys in ([], ["--keys", str(tmp_path / "stranger" / "client")]):
            assert main(["train", "--source", address, *keys, *options, "--out", str(tmp_path / "no")]) == 2
            assert "its keys and ours do not fit" in capsys.readouterr().err
    assert len(read_lines(seed_files(tmp_path / "run", 0).metrics)[0]) == 2
    assert not (tmp_path / "no" / "config.toml").exists()


def test_a_server_is_trained_on_by_what_its_cameras_see(tmp_path: Path) -> None:
    config = dataclasses.replace(default_run("landing-model"), evaluation_balls=1)
    save_config(config, tmp_path / "few.toml")
    options = ["--config", str(tmp_path / "few.toml"), "--outcomes", "events", "--speeds", "6", "--episodes", "1"]
    with serving_training(cameras=stereo_preset()) as address:
        assert main(["train", "--source", address, *options, "--out", str(tmp_path / "run")]) == 0
    assert read_run(tmp_path / "run").environment.outcomes == "events"
    lines = read_lines(seed_files(tmp_path / "run", 0).metrics)[0]
    (truth,) = draw_serve_batch(
        6.0, 1, EnvironmentConfig(state_source="truth"), np.random.default_rng([0, BALLS, 0])
    ).states
    (line,) = lines
    assert line["state"] == pytest.approx(truth.tolist(), abs=0.3) and line["state"] != truth.tolist()
    assert line["landing_m"] != [None, None]


def test_spinning_serves_are_learned_with_the_spin_in_the_state_and_the_speed_chosen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--agent", "landing-model", "--balls", "spinning", "--state", "spin", "--racket", "chosen"]
    run = tmp_path / "run"
    assert main(["train", *options, "--episodes", "6", "--out", str(run)]) == 0
    environment = read_run(run).environment
    assert (environment.state, environment.racket, environment.state_source) == ("spin", "chosen", "truth")
    assert environment.task.serve.spin_spread_radps == 100 and environment.task.physics.has_air
    (line, *_), _ = read_lines(seed_files(run, 0).metrics)
    assert len(line["state"]) == 12 and len(line["action"]) == 4  # type: ignore[arg-type]
    policy = load_policy(run)
    assert (policy.state, policy.chooses_speed) == ("spin", True)
    capsys.readouterr()
    assert main(["evaluate", str(run), "--balls", "5", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["recorded"] is False and row["balls"] == 5


def test_a_run_keeps_where_its_balls_are_met_and_an_evaluation_may_ask_for_the_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    options = ["--agent", "landing-model", "--physics", "real", "--speeds", "3", "--episodes", "3", "--hit", "chosen"]
    assert main(["train", *options, "--out", str(run)]) == 0
    assert read_run(run).environment.hit == "chosen"
    (line, *_), _ = read_lines(seed_files(run, 0).metrics)
    assert len(line["state"]) == 6 and len(line["action"]) == 3  # type: ignore[arg-type]
    rows = {}
    for asked in ("trained", "chosen", "paper"):
        capsys.readouterr()
        extra = [] if asked == "trained" else ["--hit", asked]
        assert main(["evaluate", str(run), "--balls", "8", "--json", *extra]) == 0
        rows[asked] = json.loads(capsys.readouterr().out)
    assert rows["trained"] == rows["chosen"] != rows["paper"]


def test_a_checkpoint_that_does_not_fit_the_run_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, state in (("plain", "plain"), ("spin", "spin")):
        options = ["--agent", "landing-model", "--balls", "spinning", "--state", state, "--episodes", "4"]
        assert main(["train", *options, "--out", str(tmp_path / name)]) == 0
    for file in ("policy.safetensors", "checkpoint.safetensors"):
        shutil.copy(tmp_path / "spin" / "seed-0" / file, tmp_path / "plain" / "seed-0" / file)
    capsys.readouterr()
    assert main(["evaluate", str(tmp_path / "plain"), "--balls", "5"]) == 2
    told = capsys.readouterr().err.strip()
    assert "a policy for states of the kind spin" in told and len(told.splitlines()) == 1
    assert main(["train", "--resume", "--out", str(tmp_path / "plain")]) == 2
    told = capsys.readouterr().err.strip()
    assert "states of the kind spin, the run has plain" in told and len(told.splitlines()) == 1


def test_recorded_balls_are_trained_on_and_others_kept_for_the_evaluation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    balls = write_states(tmp_path / "people.json", 600)
    run = tmp_path / "run"
    options = ["--agent", "landing-model", "--balls", str(balls), "--state", "spin", "--episodes", "4"]
    assert main(["train", *options, "--out", str(run)]) == 0
    assert "returned of the recorded balls" in capsys.readouterr().out
    assert read_run(run).environment.recorded == str(balls)
    assert main(["evaluate", str(run), "--balls", "3"]) == 0
    assert "recorded" in capsys.readouterr().out
    balls.unlink()
    assert main(["evaluate", str(run), "--balls", "3"]) == 2
    told = capsys.readouterr().err.strip()
    assert "no recorded balls" in told and len(told.splitlines()) == 1


def test_slow_serves_of_real_physics_are_said_to_be_out_of_reach(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--agent", "landing-model", "--physics", "real", "--speeds", "3", "--episodes", "2"]
    assert main(["train", *options, "--out", str(tmp_path / "run")]) == 0
    assert "% of these serves at 3 m/s to be returned" in capsys.readouterr().out
