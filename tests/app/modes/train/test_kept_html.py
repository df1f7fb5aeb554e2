"""What a stage kept of the balls before it, as Train shows it."""

import dataclasses
from pathlib import Path

from app.modes.train.kept_html import kept_html, rule_text
from app.modes.train.view import RunsViewer, ViewRequest
from app.scene.landing import CASE_NAMES
from app.shared.training.metrics import MetricsStore
from app.shared.training.trainer import Trainer
from app.shared.workspace import Workspace
from core.learning.config import CurriculumConfig
from core.learning.runs.run_files import read_lines, seed_files
from core.physics.episode import Case
from tests.app.modes.train.conftest import train_here
from tests.app.modes.train.small_runs import small_run

PAPER = CurriculumConfig()


def test_a_training_of_two_stages_tells_what_the_second_one_kept(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path / "workspace")
    config = small_run(speeds_mps=(4.0, 5.0), episodes=(30, 10))
    curriculum = dataclasses.replace(config.curriculum, replay="threshold", keep_reward=1.0)
    train_here(workspace.run_path("two"), dataclasses.replace(config, curriculum=curriculum))
    details = RunsViewer(workspace, Trainer(workspace), MetricsStore())(ViewRequest("two", None)).details
    assert details is not None and len(details.stage_starts) == 1
    (start,) = details.stage_starts
    assert start["episode"] == 30
    lines = read_lines(seed_files(workspace.run_path("two"), 0).metrics)[0]
    good = [float(str(line["reward"])) >= 1.0 - 1e-6 for line in lines[:30]]
    assert start["kept"] == sum(good) > 0 and start["dropped"] == 30 - sum(good) > 0
    text = kept_html(details.stage_starts, curriculum)
    assert f"stage 2, 5 m/s: {sum(good)} of 30 kept" in text
    for case in Case:
        of_case = [kept for kept, line in zip(good, lines[:30], strict=True) if line["case"] == case]
        words = f"{CASE_NAMES[case]} {sum(of_case)} of {len(of_case)}<"
        assert (words in text) == bool(of_case)


def test_a_bar_is_as_long_as_its_share_and_dropped_balls_are_faded() -> None:
    line: dict[str, object] = {"stage": 1, "speed_mps": 5.0, "kept": 75, "dropped": 25}
    text = kept_html((line | {"kept_cases": {"4": [75, 0], "2": [0, 25]}},), PAPER)
    assert "width:74.25%" in text and "width:24.75%" in text and text.count("opacity:0.28") == 1
    assert f"{CASE_NAMES[Case.RETURNED]} 75 of 75" in text and f"{CASE_NAMES[Case.NET]} 0 of 25" in text
    older = kept_html((line,), PAPER)  # a run of an earlier version
    assert "75 of 100 kept" in older and "width" not in older


def test_nothing_is_shown_of_one_stage_or_of_damaged_lines() -> None:
    assert kept_html((), PAPER) == ""
    damaged: tuple[dict[str, object], ...] = (
        {"kept": "x"},
        {"kept": 0, "dropped": 0, "stage": 0, "speed_mps": 5.0},
        {"kept": 3, "stage": "<b>"},
    )
    for line in damaged:
        assert kept_html((line,), PAPER) == ""
    odd: dict[str, object] = {
        "stage": 1,
        "speed_mps": 5.0,
        "kept": 1,
        "dropped": 1,
        "kept_cases": {"9": [1, 1], "4": "<img>"},
    }
    assert "img" not in kept_html((odd,), PAPER)


def test_the_rule_is_said_in_words() -> None:
    assert "at least 1" in rule_text(PAPER)
    assert rule_text(CurriculumConfig(replay="retain")) == "retain: all"
    assert rule_text(CurriculumConfig(replay="discard")) == "discard: none"
