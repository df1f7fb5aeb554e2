"""The search for the paper's settings: which are tried, which are nearest, and what the page says of them."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from benchmarks.learning import runs as learning_runs
from benchmarks.learning.paper_settings import bench_paper_settings
from benchmarks.learning.paper_settings.settings import FIGURES, SCREEN_SEED, Setting, every_setting, nearness
from benchmarks.learning.plan import Experiment
from benchmarks.learning.runs import keep_seed, load_results
from core.jobs import ALONE
from core.learning.runs.run_files import create_run
from core.learning.runs.running import run_training

NEAR, FAR = Setting("real", 0.0, 1.0, "half", "two"), Setting("paper", 0.0, 1.0, "box", "four")
RATES = {figure.episode: figure.value for figure in FIGURES if figure.is_rate and figure.training == "3-cdta"}
LATER = {figure.episode: figure.value for figure in FIGURES if figure.is_rate and figure.training == "4-cdta"}


def keep(experiment: Experiment, seed: int, folder: Path, error_scale: float, worse: float = 1.0) -> None:
    """Write what a seed would have brought: the paper's rates, and its errors times a factor."""
    factor = worse * np.random.default_rng(seed).uniform(0.9, 1.1)
    lines, episode = [], 0
    for speed, episodes in zip(
        experiment.config.curriculum.speeds_mps, experiment.config.curriculum.episodes, strict=True
    ):
        rates = RATES if speed == 3.0 else LATER
        for _ in range(0, episodes, 50):
            episode += 50
            error = error_scale * factor * {3.0: 300.0, 4.0: 226.0, 5.0: 277.0}[speed]
            returned = rates.get(episode, 0.9) * (1.0 if error_scale == 1.0 else 0.5)
            lines.append({"episode": episode, "speed_mps": speed, "returned": returned, "error_mm": error,
                          "error_returned_mm": error, "missed": 0.0})  # fmt: skip
    keep_seed((experiment, seed), {"evaluations": lines, "transfers": {}, "cpu_s": 1.0}, folder)


def test_every_setting_is_another_task_with_a_name_of_its_own() -> None:
    settings = every_setting()
    assert len({s.name for s in settings}) == len(settings) == 108
    assert len({(repr(s.environment), s.pace) for s in settings}) == 108
    slow = Setting("real", -8.0, 0.8, "point", "two")
    whole = {one.name: one.config for one in slow.trainings(3, 0, whole=True)}
    assert len(whole) == 9 and {c.ddpg.updates_per_episode for c in whole.values()} == {2}
    stroke = whole[slow.training("threshold")].environment.task.stroke
    assert stroke.base_pitch_deg == -8.0 and stroke.racket_speed.at_5_mps == pytest.approx(0.8 * 2.4)
    assert {one.config.curriculum.replay for one in slow.trainings(1, 0, whole=True)} == {
        "threshold", "discard", "retain"
    }  # fmt: skip


def test_the_nearest_setting_is_judged_by_other_seeds_and_its_claims_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, page = tmp_path / "kept", tmp_path / "page.md"
    for setting, scale in ((NEAR, 1.0), (FAR, 0.4)):
        for one in setting.trainings(1, SCREEN_SEED, whole=False):
            keep(one, SCREEN_SEED, folder, scale)
    for one in NEAR.trainings(3, 0, whole=True):
        for seed in range(3):
            keep(one, seed, folder, 1.0, worse=1.5 if one.name.endswith("discard") else 1.0)

    def never(*_: object) -> None:
        raise AssertionError("trained")

    monkeypatch.setattr(learning_runs, "run_training", never)
    shares: list[float] = []
    answer = bench_paper_settings.run(
        shares.append, folder=folder, report=page, count=3, settings=(FAR, NEAR), judged=1, engine=ALONE
    )
    rows = answer["rows"]
    assert isinstance(rows, list) and [row["setting"] for row in rows] == [NEAR.name, FAR.name]
    assert rows[0]["inside"] == len(FIGURES) and rows[1]["inside"] == 0
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1)
    text = page.read_text()
    (claim,) = [line for line in text.splitlines() if "nearer than discard" in line]
    assert "holds" in claim and "ratio 0.67" in claim
    judged = text.partition("## Judged")[2].partition("##")[0]
    assert judged.count("**") == 2 * (len(FIGURES) + 1)  # every figure, and the word in the note
    assert "0.4 x" not in judged and "our box" not in judged


def test_a_setting_with_a_training_missing_is_not_ranked(tmp_path: Path) -> None:
    trainings = NEAR.trainings(1, SCREEN_SEED, whole=False)
    keep(trainings[0], SCREEN_SEED, tmp_path, 1.0)
    assert nearness(NEAR, load_results(trainings, tmp_path)) is None


def test_a_setting_can_be_trained(tmp_path: Path) -> None:
    (_, _, climb) = NEAR.trainings(1, SCREEN_SEED, whole=False)
    curriculum = dataclasses.replace(climb.config.curriculum, episodes=(4, 4))
    config = dataclasses.replace(climb.config, curriculum=curriculum, checkpoint_every=4, evaluation_balls=10)
    create_run(tmp_path / "run", config)
    assert run_training(tmp_path / "run") == "finished"
