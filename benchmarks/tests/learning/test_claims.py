"""The paper's claims: both sides are trained alike, verdicts have known answers, and missing seeds are said."""

from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from benchmarks.learning import bench_learning
from benchmarks.learning.claims import CLAIMS, PREFIX, claim_batches, claim_experiments, claims_section, findings, holm
from benchmarks.learning.plan import Counts
from benchmarks.learning.runs import Evaluation, Results, SeedResult, fingerprint
from core.jobs import ALONE

EXPERIMENTS = {one.name.removeprefix(PREFIX): one.config for one in claim_experiments(Counts())}


def seed_results(errors_mm: list[float], returned_early: list[float]) -> list[SeedResult]:
    """One seed per error after 1,700 balls, with the return rate after 850 and 900."""
    return [
        SeedResult(
            seed,
            (
                Evaluation(850, 5.0, early, 500.0, 500.0, 0.0),
                Evaluation(900, 5.0, early, 400.0, 400.0, 0.0),
                Evaluation(1700, 5.0, 1.0, error_mm, error_mm, 0.0),
            ),
            {},
            10.0,
        )
        for seed, (error_mm, early) in enumerate(zip(errors_mm, returned_early, strict=True))
    ]


def known_results() -> Results:
    """Threshold lands at half of retain's error and 1.9 times that of 5 m/s only, and returns less than discard."""
    rng = np.random.default_rng(3)
    base = rng.uniform(80, 120, 20)
    early = rng.uniform(0.5, 0.7, 20)

    def scattered(scale: float) -> list[float]:
        return (scale * base * rng.uniform(0.95, 1.05, 20)).tolist()

    results: Results = defaultdict(list)
    results["claim-replay-threshold"] = seed_results(base.tolist(), early.tolist())
    results["claim-replay-retain"] = seed_results(scattered(2), (early + rng.uniform(-0.1, 0.1, 20)).tolist())
    results["claim-replay-discard"] = seed_results(scattered(1), (early + rng.uniform(0.2, 0.3, 20)).tolist())
    results["claim-replay-scratch"] = seed_results(scattered(1 / 1.9), early.tolist())
    results["claim-tuned-ddpg"] = results["claim-replay-threshold"]
    results["claim-tuned-td3"] = seed_results(scattered(1.5), early.tolist())
    return results


def test_rivals_take_as_many_gradient_steps_as_the_paper_s_agent_and_see_as_many_balls() -> None:
    ours = EXPERIMENTS["replay-threshold"]
    for agent in ("td3", "sac", "ppo"):
        rival = EXPERIMENTS[f"tuned-{agent}"]
        assert rival.agent == agent and rival.episodes == ours.episodes
        assert rival.rival.updates_per_episode == ours.ddpg.updates_per_episode
        assert rival.rival.exploration == "matched" and rival.reward.kind == "case"


def test_all_have_the_same_drawn_seeds_which_nothing_was_chosen_on() -> None:
    (first,) = {config.first_seed for config in EXPERIMENTS.values()}
    assert first >= 1_000_000
    assert {name for one in CLAIMS for name in (one.ours, one.theirs)} <= EXPERIMENTS.keys()
    assert EXPERIMENTS["replay-threshold"].seeds == 40 and EXPERIMENTS["tuned-sac"].seeds == 20
    assert len({fingerprint(config) for config in EXPERIMENTS.values()}) == len(EXPERIMENTS)


def test_what_is_interrupted_has_equal_seeds_of_what_is_compared() -> None:
    experiments = claim_experiments(Counts())
    flat = [(one.name, seed) for batch in claim_batches(experiments) for one, seed in batch]
    assert len(flat) == len(set(flat)) == sum(one.config.seeds for one in experiments)
    first = [name for name, _ in flat[:5]]
    assert first == [f"claim-{name}" for name in ("replay-threshold", "replay-discard", "replay-retain",
                                                  "replay-scratch", "straight-case")]  # fmt: skip
    assert [name for name, _ in flat[5:10]] == first


def test_verdicts_are_the_known_ones() -> None:
    found = {(one.claim.theirs, one.claim.what, one.claim.episode): one for one in findings(known_results())}
    retain = found["replay-retain", "error_mm", 1700]
    assert retain.verdict == "holds" and retain.estimate == pytest.approx(0.5, rel=0.03) and retain.seeds == 20
    assert retain.low < retain.estimate < retain.high
    assert found["replay-discard", "error_mm", 1700].verdict == "not shown"
    early = found["replay-discard", "returned", 850]
    assert early.verdict == "contradicted" and early.estimate == pytest.approx(-25, abs=2)
    assert found["replay-retain", "returned", 900].verdict == "not shown"
    assert found["replay-scratch", "error_mm", 1700].verdict == "contradicted"


def test_a_margin_that_is_missed_contradicts_a_claim_of_it() -> None:
    """A third less error than TD3 is better, and not 35.8 % better."""
    td3 = next(one for one in findings(known_results()) if one.claim.theirs == "tuned-td3")
    assert td3.estimate == pytest.approx(1 / 1.5, rel=0.02)
    assert td3.low > 1 - 0.358 and td3.verdict == "contradicted"


def test_a_claim_without_seeds_is_not_shown_and_counts_in_the_correction() -> None:
    found = findings(known_results())
    missing = next(one for one in found if one.claim.theirs == "tuned-sac")
    assert (missing.seeds, missing.p_value, missing.verdict) == (0, 1.0, "not shown")
    assert len(found) == len(CLAIMS)


def test_holm_s_correction_is_the_textbook_s() -> None:
    # Smallest first: 4 x 0.01, 3 x 0.02, 2 x 0.03 (at least what came before), 1 x 0.04 (so too).
    assert holm([0.04, 0.01, 0.03, 0.02]) == pytest.approx([0.06, 0.04, 0.06, 0.06])
    assert holm([0.9, 0.8]) == [1.0, 1.0] and holm([]) == []


def test_the_section_says_which_seeds_there_are() -> None:
    text = claims_section(claim_experiments(Counts()), known_results())
    assert "0-19 (20 of 40 that are wanted): threshold" in " ".join(text.split())
    assert "| threshold lands nearer to the target than retain | 20 | 0.5" in text and "| holds |" in text
    assert "| 5 m/s only | 20 |" in text and "SAC, default |" not in text


def test_the_bench_makes_the_section_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    report = tmp_path / "report.md"
    report.write_text("# Learning to return: what was measured\n\n## Curves\n\nkept\n")
    counts = Counts(balls=5, shorten=50, claim_seeds=1)
    few = tuple(one for one in claim_experiments(counts) if one.name in ("claim-replay-threshold", "claim-tuned-td3"))
    monkeypatch.setattr(bench_learning, "claim_experiments", lambda counts: few)
    where = {"folder": tmp_path / "runs", "report": report, "counts": counts, "engine": ALONE}
    rows = bench_learning.run(lambda share: None, **where, only="claims")["rows"]  # type: ignore[arg-type]
    assert isinstance(rows, list) and [row["seeds"] for row in rows] == [1, 1]
    text = report.read_text()
    assert "## The paper's claims" in text and text.endswith("kept\n")
