from dataclasses import replace

import numpy as np
import pytest

from benchmarks.rally.bench_rally import Watched, cause_of_loss, chain_named, measure_rally, run
from benchmarks.rally.closed_loop import PlayedBall
from core.cameras.presets import SENSOR_720
from core.chain.config import ChainConfig
from core.chain.control.controller import RacketDecision
from core.chain.control.hit_choice import HitChoice
from core.live.worlds.world import ClassifiedBall
from core.physics.episode import Case
from core.recordings import BallTruth
from core.simulation.episodes.ball_outcome import BallOutcome, RallyEvent
from core.simulation.episodes.racket import RacketTarget
from core.trajectory import PaperPredictorConfig


def test_two_balls_give_a_row_whose_parts_agree() -> None:
    row = measure_rally(SENSOR_720, 5.0, 2)
    assert row["balls"] == 2 and row["seen"] == 1.0
    others = sum(int(row[name]) for name in ("own_half", "net", "out", "missed"))  # type: ignore[call-overload]
    assert others == 2 - 2 * row["returned"]  # type: ignore[operator]
    assert 0.1 < row["point_mm_median"] < 5.0 <= 5.0 + row["point_mm_p95"]  # type: ignore[operator]
    assert row["points"] > 200 and 0 < row["step_ms_p50"] <= row["step_ms_p99"]  # type: ignore[operator]


def test_another_prediction_plays_another_rally() -> None:
    fit, filtered = (
        measure_rally(SENSOR_720, 9.0, 1, chain=ChainConfig(prediction=kind)) for kind in ("fit", "filter")
    )
    assert fit["point_mm_median"] == pytest.approx(filtered["point_mm_median"], rel=0.2)
    assert fit["aim_mm_median"] != filtered["aim_mm_median"]


def test_the_paper_s_chain_has_nothing_better_than_the_paper() -> None:
    published = chain_named("paper")
    assert published.method == "paper" and published.prediction == "fit"
    assert published.predictor == PaperPredictorConfig(hurry_ms=0.0, bounce_guard_ms=0.0, bounce_wait_ms=0.0)
    assert published.predictor.observations == 5 and published.predictor.friction == 0.0
    assert chain_named("fit").method == chain_named("filter").method == "refined"


def test_the_page_has_a_table_for_each_chain_that_played(tmp_path) -> None:
    page = tmp_path / "rally.md"
    found = run(lambda share: None, chain="filter", balls=1, speeds=(9.0,), report=page)
    (row,) = found["rows"]  # type: ignore[misc]
    assert row["chain"] == "filter" and row["speed_mps"] == 9.0 and row["balls"] == 1
    text = page.read_text()
    assert "## `filter`" in text and "`paper`" not in text.partition("## ")[2]
    assert f"| 9 | 1 | {100 * row['returned']:.0f} (" in text and "21-100" in text, "one ball proves little"


def test_errors_are_distances_to_the_truth_at_the_points_own_times() -> None:
    t_us = np.arange(0, 5000, 500)
    p = np.outer(t_us * 1e-6, [4.0, 0.0, 0.0])
    nothing = np.zeros((10, 3))
    watched = Watched(truth=[BallTruth(t_us, p, nothing, nothing, np.ones(10, bool))])
    watched.t_us, watched.ps_world_m = [1250, 9000], [np.array([0.005, 0.003, 0.0]), np.zeros(3)]
    assert watched.errors_m() == pytest.approx([0.003])  # nobody knows of the second one
    assert len(Watched().errors_m()) == 0


def test_balls_that_are_told_at_the_launch_come_back_in_real_physics_and_have_a_page(tmp_path) -> None:
    page = tmp_path / "known.md"
    found = run(lambda share: None, chain="known", balls=4, speeds=(5.0,), physics="real", report=page)
    (row,) = found["rows"]  # type: ignore[misc]
    assert row["returned"] == 1.0 and row["landing_mm_p95"] < 1.0
    assert sum(row[name] for name in ("own_half", "net", "out", "missed")) == 0
    text = page.read_text()
    assert "physics `real`" in text and "## `known`" in text and "| 5 | 4 | 100 (51-100) |" in text


def test_other_seeds_and_steeper_serves_are_other_balls_and_lost_ones_have_a_cause() -> None:
    rows = [
        run(
            lambda share: None, chain="points", balls=2, speeds=(3.0,), unknown=True, seed=seed, elevation_spread=spread
        )
        for seed, spread in ((1, 0.0), (1, 8.0), (3, 8.0))
    ]
    first, steeper, other = (found["rows"][0] for found in rows)  # type: ignore[index]
    assert len({row["points"] for row in (first, steeper, other)}) == 3, "each is another flight"
    for row in (first, steeper, other):
        assert sum(row["lost"].values()) == round(2 * (1 - row["returned"]))


def test_a_ball_that_is_met_before_the_plane_has_a_newest_hit_point_too() -> None:
    found = run(lambda share: None, chain="points", balls=1, speeds=(3.0,), physics="real", hit="chosen", seed=7)
    (at_50_ms,) = (row for row in found["hit_point"] if row["lead_ms"] == 50)  # type: ignore[attr-defined]
    assert at_50_ms["told"] == 1 and at_50_ms["median_mm"] < 20


def test_a_ball_is_lost_for_what_was_chosen_before_what_was_seen() -> None:
    nobody = HitChoice(0, None, (), "below the table's top")
    ball = PlayedBall(3.0, judged(Case.MISSED), (), float("nan"), nobody)
    assert cause_of_loss(ball) == "no stroke: below the table's top"
    assert cause_of_loss(replace(ball, choice=None)) == "no command"
    decided = replace(ball, choice=None, decisions=(decision(z_m=-0.02),), aim_error_m=0.003)
    assert cause_of_loss(decided) == "hit below the table's top"
    assert cause_of_loss(replace(decided, aim_error_m=0.05)) == "predicted wrong"
    assert cause_of_loss(replace(decided, decisions=(decision(z_m=0.2),))) == "missed, hit at x = -1.42 m, z = 0.20 m"


def decision(*, z_m: float) -> RacketDecision:
    at = np.array([-1.42, 0.0, z_m])
    target = RacketTarget(at, np.array([1.0, 0, 0, 0]), np.zeros(3), 1.0)
    return RacketDecision(stage="post", state=np.r_[at, np.zeros(3)], goal_m=at[:2], target=target, action=np.zeros(3))


def judged(case: Case) -> ClassifiedBall:
    nowhere = np.full(6, np.nan)
    serve = RallyEvent("serve", 0.0, np.zeros(9), np.zeros(9))
    return ClassifiedBall(
        BallOutcome(case, 1.0, np.full(3, np.nan), np.full(3, np.nan), np.nan), serve, nowhere, np.full(4, np.nan)
    )
