"""The bench of learning with tiny counts: the same code, resumed rather than repeated, and a whole report."""

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from core.bench.learning import bench_learning
from core.bench.learning import runs as learning_runs
from core.bench.learning.beyond import event_cameras
from core.bench.learning.plan import EXPLORATIONS, RIVALS, Counts, plan, rival_training
from core.bench.learning.tables import paired
from core.bench.learning.targets import TARGETS
from core.bench.learning.verdicts import CLAIMS, judge
from core.jobs import ALONE
from core.learning.runs.summary import SeedSpread
from core.metrics.intervals import binomial_interval

TINY = Counts(seeds=2, minor_seeds=1, rival_seeds=1, balls=10, shorten=50)


def test_the_bench_makes_a_report_and_does_not_train_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = tuple(e for e in plan(TINY) if e.name.startswith(("reward-4", "replay", "model-5", "rival-5-matched-td3")))
    monkeypatch.setattr(bench_learning, "plan", lambda counts: wanted)
    shares: list[float] = []
    where = {"folder": tmp_path / "runs", "report": tmp_path / "docs" / "report.md", "counts": TINY, "engine": ALONE}
    first = bench_learning.run(shares.append, **where)  # type: ignore[arg-type]
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1)
    rows = first["rows"]
    assert isinstance(rows, list) and [row["training"] for row in rows] == [e.name for e in wanted]
    text = (tmp_path / "docs" / "report.md").read_text()
    for heading in ("three rewards", "Replay rules", "Against PPO", "Beyond", "Without learning"):
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
    assert {seed for _, seed in found[0]} == set(range(bench_learning.SEEDS_AT_A_TIME))
    flat = [(e.name, seed) for batch in found for e, seed in batch]
    assert len(flat) == len(set(flat)) == sum(e.config.seeds for e in experiments)


def test_td3_is_not_trained_twice_for_an_exploration_that_is_its_default() -> None:
    names = {e.name for e in plan(Counts())}
    for exploration in EXPLORATIONS:
        assert {rival_training("5", exploration, agent) for agent in RIVALS} <= names
    assert rival_training("5", "default", "td3") == rival_training("5", "matched", "td3")
    assert rival_training("5", "default", "sac") != rival_training("5", "matched", "sac")


def test_every_figure_aimed_at_is_the_episode_of_an_evaluation_of_a_planned_training() -> None:
    planned = {e.name: e.config for e in plan(Counts())}
    for target in TARGETS:
        config = planned[target.training]
        assert target.episode <= config.episodes and target.episode % config.checkpoint_every == 0
        assert config.seeds >= 20 and config.evaluation_balls == 500


def test_names_are_unique_and_a_changed_setting_is_another_result() -> None:
    experiments = plan(Counts())
    assert len({e.name for e in experiments}) == len(experiments)
    configs = [learning_runs.fingerprint(e.config) for e in experiments]
    assert len(set(configs)) >= len(configs) - 1  # one variant may be the default written out


def test_paired_differences_use_the_seeds_that_both_have() -> None:
    def result(seed: int, error: float) -> learning_runs.SeedResult:
        evaluation = learning_runs.Evaluation(100, 5.0, 1.0, error, error)
        return learning_runs.SeedResult(seed, (evaluation,), {}, 1.0)

    a = [result(0, 10.0), result(1, 21.0), result(2, 30.0)]
    b = [result(0, 15.0), result(1, 26.0), result(3, 99.0)]
    assert paired(a, b, 100, "error_mm").startswith("-5.0 [-5.0, -5.0], differs")
    assert paired(a, b, 200, "error_mm") == "-"


def test_the_interval_of_fifty_balls_is_wilson_s() -> None:
    low, high = binomial_interval(0.98, 50)
    assert (round(low, 3), round(high, 3)) == (0.895, 0.996)


def test_a_claim_holds_only_if_the_whole_interval_is_on_its_side() -> None:
    nearer, farther, unsure = SeedSpread(-9, 1, -12, -6, 5), SeedSpread(9, 1, 6, 12, 5), SeedSpread(-1, 3, -4, 2, 5)
    assert judge(nearer, more_is_better=False) == judge(farther, more_is_better=True) == "holds"
    assert judge(nearer, more_is_better=True) == judge(farther, more_is_better=False) == "**contradicted**"
    assert judge(unsure, more_is_better=True) == judge(unsure, more_is_better=False) == "not shown"
    assert judge(SeedSpread(1, 1, 1, 1, 1), more_is_better=True) == "-"


def test_what_was_evaluated_before_cameras_stands_in_the_report(tmp_path: Path) -> None:
    assert bench_learning.read_chain(tmp_path) == [] and event_cameras([]) == ""
    row = {"speed_mps": 5.0, "balls": 200, "seeds": 3, "episodes": 150, "returned": 0.985}
    row |= {"error_mm": {"mean": 30.4, "median": 21.0, "p95": 80.0}, "seeds_error_mm": {"std": 2.0}}
    (tmp_path / bench_learning.CHAIN).write_text(json.dumps([row]))
    text = event_cameras(bench_learning.read_chain(tmp_path))
    assert "| 5 | 3 | 150 | 200 | 98.5 | 30 ± 2 | 21 | 80 |" in text


def test_every_claim_names_two_planned_trainings_and_an_evaluated_episode() -> None:
    planned = {e.name: e.config for e in plan(Counts())}
    for claim in CLAIMS:
        for name in (claim.better, claim.worse):
            assert claim.episode % planned[name].checkpoint_every == 0 and claim.episode <= planned[name].episodes
