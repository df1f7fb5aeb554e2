"""The bench of learning with tiny counts: the same code, resumed rather than repeated, and a whole report."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from benchmarks.learning import bench_learning
from benchmarks.learning import runs as learning_runs
from benchmarks.learning.claims import claim_experiments
from benchmarks.learning.plan import EXPLORATIONS, RIVALS, Counts, counts_of, plan, rival_training
from benchmarks.learning.real_balls import real_experiments
from benchmarks.learning.report import event_cameras
from benchmarks.learning.runs import PlayedSeed, event_training, load_played, play_seed
from core.jobs import ALONE
from core.metrics.score import binomial_interval

TINY = Counts(seeds=2, minor_seeds=1, balls=10, shorten=50, event_seeds=0, claim_seeds=2)


def test_the_bench_makes_a_report_and_does_not_train_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = tuple(e for e in plan(TINY) if e.name.startswith(("reward-4", "replay", "model-5", "rival-5-matched-td3")))
    claims = tuple(e for e in claim_experiments(TINY) if e.name in ("claim-replay-threshold", "claim-replay-discard"))
    monkeypatch.setattr(bench_learning, "plan", lambda counts: wanted)
    monkeypatch.setattr(bench_learning, "claim_experiments", lambda counts: claims)
    shares: list[float] = []
    where = {"folder": tmp_path / "runs", "report": tmp_path / "docs" / "report.md", "counts": TINY, "engine": ALONE}
    first = bench_learning.run(shares.append, **where)  # type: ignore[arg-type]
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1)
    rows = first["rows"]
    every = (*wanted, *real_experiments(TINY, None), *claims)
    assert isinstance(rows, list) and [row["training"] for row in rows] == [e.name for e in every]
    text = (tmp_path / "docs" / "report.md").read_text()
    for heading in (
        "three rewards",
        "Replay rules",
        "Against PPO",
        "Beyond",
        "Without learning",
        "Real balls",
        "The paper's claims",
    ):
        assert heading in text
    for chart in sorted((tmp_path / "docs" / "images").glob("learning-*.svg")):
        ElementTree.fromstring(chart.read_text())

    def never(*_: object) -> None:
        raise AssertionError("trained again")

    monkeypatch.setattr(learning_runs, "run_training", never)
    assert bench_learning.run(lambda share: None, **where)["rows"] == rows  # type: ignore[arg-type]


def test_a_batch_holds_a_few_seeds_of_every_training_and_all_batches_every_seed_once() -> None:
    experiments = plan(Counts())
    found = bench_learning.batches(experiments)
    assert {e.name for e, _ in found[0]} == {e.name for e in experiments}
    assert {s - e.config.first_seed for e, s in found[0]} == set(range(bench_learning.SEEDS_AT_A_TIME))
    flat = [(e.name, seed) for batch in found for e, seed in batch]
    assert len(flat) == len(set(flat)) == sum(e.config.seeds for e in experiments)


def test_td3_is_not_trained_twice_for_an_exploration_that_is_its_default() -> None:
    names = {e.name for e in plan(Counts())}
    for exploration in EXPLORATIONS:
        assert {rival_training("5", exploration, agent) for agent in RIVALS} <= names
    assert rival_training("5", "default", "td3") == rival_training("5", "matched", "td3")
    assert rival_training("5", "default", "sac") != rival_training("5", "matched", "sac")


def test_names_are_unique_and_a_changed_setting_is_another_result() -> None:
    experiments = plan(Counts())
    assert len({e.name for e in experiments}) == len(experiments)
    configs = [(learning_runs.fingerprint(e.config), e.config.first_seed) for e in experiments]
    assert len(set(configs)) >= len(configs) - 1  # one variant may be the default written out


def test_the_interval_of_fifty_balls_is_wilson_s() -> None:
    low, high = binomial_interval(0.98, 50)
    assert (round(low, 3), round(high, 3)) == (0.895, 0.996)


def test_what_was_played_before_cameras_stands_in_the_report() -> None:
    assert event_cameras([], Counts()) == ""
    played = [
        PlayedSeed(seed, np.array([True, True, True, False]), np.array([10.0, 20.0, 30.0 + 4 * seed, np.nan]))
        for seed in range(2)
    ]
    text = event_cameras(played, Counts(event_episodes=7, event_balls=4))
    # (10 + 20 + 30 + 2740) / 4 = 700 and 701; a missed ball of four.
    assert (
        "| 5 | 2 | 7 | 4 | 75.0 ± 0.0 [75.0, 75.0] | 25.0 ± 0.0 [25.0, 25.0] | 700 ± 1 [694, 707] | 25 | 2740 |" in text
    )


def test_the_bench_itself_plays_the_event_seeds_once_and_keeps_them(tmp_path: Path) -> None:
    training = event_training(Counts(event_seeds=1, event_balls=1, event_episodes=1))
    assert play_seed(training, tmp_path, 0)
    assert not play_seed(training, tmp_path, 0), "played again"
    (played,) = load_played(training, tmp_path)
    assert len(played.returned) == len(played.errors_mm) == 1
    assert not list(tmp_path.rglob("*.run")), "the run itself is not kept"
    more = event_training(Counts(event_seeds=1, event_balls=2, event_episodes=1))
    assert load_played(more, tmp_path) == [], "another number of balls is another result"


def test_the_full_event_row_has_five_seeds_of_two_hundred_balls() -> None:
    assert (Counts().event_seeds, Counts().event_balls) == (5, 200)


def test_the_number_of_seeds_is_set_for_both_sides_at_once() -> None:
    counts = counts_of(3)
    assert (counts.seeds, counts.minor_seeds, counts.event_seeds) == (3, 3, 3)
    assert (counts_of(20), counts_of(40).minor_seeds) == (Counts(claim_seeds=20), 10)
