"""Runs on disk: killed, paused, stopped and gone on with, they give the same numbers."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.errors import ConfigError
from core.learning.config import CurriculumConfig, EnvironmentConfig, RunConfig
from core.learning.evaluation.policy_evaluator import PolicyEvaluator
from core.learning.runs.run_files import (
    Control,
    RunStatus,
    create_run,
    hold_run,
    load_checkpoint,
    load_policy,
    read_control,
    read_lines,
    read_run,
    read_status,
    seed_files,
    write_control,
)
from core.learning.runs.running import run_training
from tests.waiting import PATIENCE_S, eventually

pytestmark = pytest.mark.numeric
CONFIG = RunConfig(
    environment=EnvironmentConfig(state_source="truth"),
    curriculum=CurriculumConfig(speeds_mps=(3.0, 5.0), episodes=(70, 60)),
    checkpoint_every=20,
    evaluation_balls=20,
)
TRAIN = (
    "import sys; from pathlib import Path; from core.learning.runs.running import run_training; "
    "print(run_training(Path(sys.argv[1]), progress=lambda s: None, stopped=lambda: False))"
)
TRAIN_STEPWISE = """
import sys
from pathlib import Path
from core.learning.runs import running, training
training.STATUS_EVERY_S = 0.0  # every line of the metrics is on disk at once
def stopped():
    print(flush=True)
    return not sys.stdin.readline()
running.run_training(Path(sys.argv[1]), stopped=stopped)
"""
"""Waits for a line of its input before every episode."""


def train(run: Path, config: RunConfig = CONFIG) -> Path:
    create_run(run, config)
    assert run_training(run, progress=lambda share: None, stopped=lambda: False) == "finished"
    return run


def assert_same_run(a: Path, b: Path) -> None:
    for name in ("metrics.jsonl", "evaluations.jsonl"):
        assert (a / "seed-0" / name).read_bytes() == (b / "seed-0" / name).read_bytes(), name
    ours, theirs = (load_checkpoint(seed_files(run, 0).checkpoint) for run in (a, b))
    assert ours[1] == theirs[1] and ours[0].keys() == theirs[0].keys()
    for name, array in ours[0].items():
        np.testing.assert_array_equal(array, theirs[0][name], err_msg=name)
    for name in ("policy.safetensors", "best.safetensors"):
        assert (a / "seed-0" / name).read_bytes() == (b / "seed-0" / name).read_bytes(), name


def wait_for_episode(run: Path, episode: int) -> None:
    metrics = seed_files(run, 0).metrics
    eventually(lambda: len(read_lines(metrics)[0]) >= episode, f"episode {episode}")


def wait_for_status(run: Path) -> RunStatus:
    """The next status that the training writes; while it is paused it does so from time to time."""
    path = run / "status.json"
    before_ns = path.stat().st_mtime_ns
    eventually(lambda: path.stat().st_mtime_ns > before_ns, "another status")
    status = read_status(run)
    assert status is not None
    return status


def test_the_best_policy_is_chosen_by_validation_balls_and_never_by_the_test_balls(tmp_path: Path) -> None:
    # Of this seed the policy that is best on the validation balls is 74 mm worse on the test balls than the best there.
    run = train(tmp_path / "run", replace(CONFIG, checkpoint_every=5, first_seed=9))
    files = seed_files(run, 9)
    lines = [line for line in read_lines(files.evaluations)[0] if line["speed_mps"] == 5.0]
    by_validation, by_test = (
        min(lines, key=lambda line: float(str(line[name])))["episode"] for name in ("validation_mm", "error_mm")
    )
    assert by_validation != by_test, "this run cannot tell the two apart"
    chosen, other = (files.policy_at(int(str(episode))).read_bytes() for episode in (by_validation, by_test))
    assert files.best.read_bytes() == chosen != other
    # What stands in the lines is what these balls say.
    policy = load_policy(run, 9, "best")
    evaluator = PolicyEvaluator(CONFIG.environment, CONFIG.evaluation_balls)
    line = next(line for line in lines if line["episode"] == by_validation)
    assert line["validation_mm"] == pytest.approx(evaluator.score(policy, 5.0, "validation").error_mm, abs=1e-3)
    assert line["error_mm"] == pytest.approx(evaluator.score(policy, 5.0).error_mm, abs=1e-3)


@pytest.mark.gate
def test_a_killed_run_goes_on_bit_for_bit(tmp_path: Path) -> None:
    whole = train(tmp_path / "whole")
    killed = tmp_path / "killed"
    create_run(killed, CONFIG)
    command = [sys.executable, "-c", TRAIN_STEPWISE, str(killed)]
    for checkpoint, episode in ((0, 30), (20, 75)):
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdin is not None and process.stdout is not None
            for _ in range(episode - checkpoint):
                process.stdout.readline()
                process.stdin.write("\n")
                process.stdin.flush()
            process.kill()
        status = read_status(killed)
        assert status is not None and status.state == "failed"
        assert len(read_lines(seed_files(killed, 0).metrics)[0]) in (episode - 2, episode - 1)
    # Whatever came after the checkpoint, half a line included, is made again.
    with (killed / "seed-0" / "metrics.jsonl").open("ab") as file:
        file.write(b'{"episode": 7')
    assert run_training(killed, progress=lambda share: None, stopped=lambda: False) == "finished"
    assert_same_run(whole, killed)


def test_a_stopped_run_goes_on_bit_for_bit(tmp_path: Path) -> None:
    whole = train(tmp_path / "whole")
    stopped = tmp_path / "stopped"
    create_run(stopped, CONFIG)
    asked = iter(range(10**6))
    assert run_training(stopped, progress=lambda share: None, stopped=lambda: next(asked) == 33) == "stopped"
    status = read_status(stopped)
    assert status is not None and status.state == "stopped"
    assert len(read_lines(seed_files(stopped, 0).metrics)[0]) == 33
    assert run_training(stopped, progress=lambda share: None, stopped=lambda: False) == "finished"
    assert_same_run(whole, stopped)


def test_another_process_pauses_slows_and_stops_a_run(tmp_path: Path) -> None:
    run = tmp_path / "run"
    endless = CurriculumConfig(speeds_mps=(3.0, 5.0), episodes=(2000, 2000))  # not over before it is paused
    create_run(run, replace(CONFIG, curriculum=endless))
    write_control(run, Control(episodes_per_s=10))
    process = subprocess.Popen([sys.executable, "-c", TRAIN, str(run)], stdout=subprocess.PIPE, text=True)
    wait_for_episode(run, 5)
    write_control(run, Control("pause"))
    while wait_for_status(run).state != "paused":
        pass
    before = len(read_lines(seed_files(run, 0).metrics)[0])
    for _ in range(2):
        status = wait_for_status(run)
        assert status.state == "paused"
        assert len(read_lines(seed_files(run, 0).metrics)[0]) == before == status.episode
    assert process.poll() is None
    with pytest.raises(ConfigError, match="another process"), hold_run(run):
        pass
    write_control(run, Control("stop"))
    assert process.communicate(timeout=PATIENCE_S)[0].strip() == "stopped"
    assert read_control(run).command == "stop"


def test_every_seed_has_its_own_files_and_the_progress_ends_at_one(tmp_path: Path) -> None:
    shares: list[float] = []
    create_run(tmp_path / "run", RunConfig(**{**_fields(CONFIG), "seeds": 2, "first_seed": 5}))
    run_training(tmp_path / "run", progress=shares.append, stopped=lambda: False)
    assert shares == sorted(shares) and shares[-1] == 1
    lines = [read_lines(seed_files(tmp_path / "run", seed).metrics)[0] for seed in (5, 6)]
    assert [len(part) for part in lines] == [130, 130] and lines[0] != lines[1]
    status = read_status(tmp_path / "run")
    assert status is not None and (status.state, status.share) == ("finished", 1.0)
    assert load_policy(tmp_path / "run", 6).racket_speed_mps([-1.42, 0, 0.3, -1.9, 0, 0]) == pytest.approx(3.0)
    assert read_run(tmp_path / "run").seeds == 2
    assert json.loads((tmp_path / "run" / "versions.json").read_text())["torch"]


def test_every_line_of_the_metrics_can_be_plotted(tmp_path: Path) -> None:
    lines, end = read_lines(seed_files(train(tmp_path / "run"), 0).metrics)
    assert [line["episode"] for line in lines] == list(range(130))
    assert {"speed_mps", "case", "reward", "landing_m", "goal_m", "error_mm", "noise", "w1", "w2", "buffer"} <= set(
        lines[0]
    )
    assert lines[70]["kept"] + lines[70]["dropped"] == 70  # type: ignore[operator]
    assert read_lines(seed_files(tmp_path / "run", 0).metrics, end) == ([], end)


def test_a_run_is_not_overwritten_and_a_folder_without_one_is_told(tmp_path: Path) -> None:
    create_run(tmp_path / "run", CONFIG)
    with pytest.raises(ConfigError, match="there is a run already"):
        create_run(tmp_path / "run", CONFIG)
    with pytest.raises(ConfigError, match="not a training run"):
        run_training(tmp_path, progress=lambda share: None, stopped=lambda: False)
    with pytest.raises(ConfigError, match="without a policy"):
        load_policy(tmp_path / "run")


def test_a_control_file_of_nonsense_lets_the_run_go_on(tmp_path: Path) -> None:
    (tmp_path / "control.json").write_text('{"command": ["stop"], "episodes_per_s": -3}')
    assert read_control(tmp_path) == Control()
    (tmp_path / "control.json").write_text('{"command": "st')
    assert read_control(tmp_path) == Control()


def _fields(config: RunConfig) -> dict[str, object]:
    return {name: getattr(config, name) for name in config.__dataclass_fields__}
