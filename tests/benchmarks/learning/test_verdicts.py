"""What the claims make of synthetic trainings: same seeds or nothing, paired ratios, one family, both statistics."""

from collections import defaultdict

import numpy as np
import pytest

from benchmarks.learning.report import TARGETS, targets_table
from benchmarks.learning.runs import Evaluation, Results, SeedResult
from benchmarks.learning.tables import paired
from benchmarks.learning.verdicts import CLAIMS, Claim, Finding, judge_claims, verdicts
from core.errors import ConfigError

NEARER = Claim("ours nearer", "ours", "theirs", 100, "error_mm")
HALF = Claim("ours at most half", "ours", "theirs", 100, "error_mm", 0.5)
MORE = Claim("ours returns more", "ours", "theirs", 100, "returned")


def trained(errors: np.ndarray, *, first_seed: int = 0, end: int = 100) -> list[SeedResult]:
    """Seeds whose last error is given and whose evaluations before were 10 and 20 mm better."""
    return [
        SeedResult(
            first_seed + i,
            tuple(
                Evaluation(n, 5.0, 0.9, e, e, 0.0)
                for n, e in ((end - 50, error - 20), (end - 25, error - 10), (end, error))
            ),
            {},
            1.0,
        )
        for i, error in enumerate(errors.tolist())
    ]


def results_of(**trainings: list[SeedResult]) -> Results:
    found: Results = defaultdict(list)
    found.update(trainings)
    return found


def draws(ratio: float, count: int = 20, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    theirs = 100 * np.exp(rng.normal(0, 0.3, count))
    return ratio * theirs * np.exp(rng.normal(0, 0.1, count)), theirs


def only(found: list[Finding | ConfigError | None]) -> Finding:
    (one,) = found
    assert isinstance(one, Finding)
    return one


def test_a_claim_is_refused_when_the_seed_sets_differ_and_the_report_says_so_in_one_line() -> None:
    ours, theirs = draws(0.5)
    results = results_of(ours=trained(ours), theirs=trained(theirs[:5]))
    (refused,) = judge_claims(results, [NEARER], "last")
    assert isinstance(refused, ConfigError)
    assert "seeds differ" in str(refused) and "0-19" in str(refused) and "0-4" in str(refused)
    claim = CLAIMS[-1]
    text = verdicts(
        results_of(
            **{
                claim.better: trained(ours, end=claim.episode),
                claim.worse: trained(theirs, first_seed=1, end=claim.episode),
            }
        )
    )
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {claim.text} ")]
    assert "seeds differ" in line and "holds" not in line and "contradicted" not in line


def test_a_table_refuses_too() -> None:
    a, b = trained(np.array([10.0, 21.0])), trained(np.array([15.0, 26.0, 3.0]))
    assert "seeds differ" in paired(a, b, 100, "error_mm")
    assert paired(a, b[:2], 100, "error_mm") == "-5.0 [-5.0, -5.0]"


def test_a_known_ratio_is_found_and_judged_against_the_claimed_one() -> None:
    ours, theirs = draws(0.4)
    results = results_of(ours=trained(ours), theirs=trained(theirs))
    found = only(judge_claims(results, [HALF], "last"))
    assert found.ratio is not None and found.ratio.low < 0.4 < found.ratio.high < 0.5
    assert found.seeds == tuple(range(20)) and found.verdict == "holds"
    ours, theirs = draws(0.7)
    found = only(judge_claims(results_of(ours=trained(ours), theirs=trained(theirs)), [HALF], "last"))
    assert found.verdict == "**contradicted**", "nearer, but not so much nearer as is claimed"
    assert (
        only(judge_claims(results_of(ours=trained(ours), theirs=trained(theirs)), [NEARER], "last")).verdict == "holds"
    )
    ours, theirs = draws(0.5, seed=3)
    found = only(judge_claims(results_of(ours=trained(ours), theirs=trained(theirs)), [HALF], "last"))
    assert found.verdict == "not shown", "right at the claimed ratio"


def test_the_five_best_are_the_lowest_evaluations_and_a_statistic_of_their_own() -> None:
    ours, theirs = draws(0.5)
    results = results_of(ours=trained(ours), theirs=trained(theirs))
    last, best = (only(judge_claims(results, [NEARER], statistic)) for statistic in ("last", "five best"))  # type: ignore[arg-type]
    assert last.difference.estimate == pytest.approx(best.difference.estimate)  # both sides 10 mm lower
    assert last.ratio is not None and best.ratio is not None
    assert best.ratio.estimate == pytest.approx(np.exp(np.mean(np.log((ours - 10) / (theirs - 10)))))
    assert last.ratio.estimate != best.ratio.estimate


def test_a_family_corrects_what_alone_would_hold() -> None:
    theirs = np.linspace(80, 120, 20)
    ours = theirs * np.exp(-0.02 + 0.06 * np.linspace(-1, 1, 20)[::-1])
    results = results_of(ours=trained(ours), theirs=trained(theirs))
    alone = only(judge_claims(results, [NEARER], "last"))
    assert alone.verdict == "holds" and 0.005 < alone.p < 0.05
    family = judge_claims(results, [NEARER] * 30, "last")
    assert {one.verdict for one in family if isinstance(one, Finding)} == {"not shown"}
    assert all(one.p == pytest.approx(min(1.0, 30 * alone.p)) for one in family if isinstance(one, Finding))


def test_return_rates_are_compared_by_their_difference_and_have_no_five_best() -> None:
    rng = np.random.default_rng(5)
    worse, better = rng.uniform(0.7, 0.9, 20), rng.uniform(0.9, 1.0, 20)

    def rates(values: np.ndarray) -> list[SeedResult]:
        return [SeedResult(i, (Evaluation(100, 5.0, v, 50, 50, 0.0),), {}, 1.0) for i, v in enumerate(values.tolist())]

    results = results_of(ours=rates(better), theirs=rates(worse))
    found = only(judge_claims(results, [MORE], "last"))
    assert found.ratio is None and found.verdict == "holds"
    assert found.difference.estimate == pytest.approx(100 * np.mean(better - worse))
    assert (
        only(judge_claims(results_of(ours=rates(worse), theirs=rates(better)), [MORE], "last")).verdict
        == "**contradicted**"
    )
    assert judge_claims(results, [MORE], "five best") == [None]


def test_one_seed_has_no_verdict_and_nothing_trained_is_nothing() -> None:
    one = only(
        judge_claims(results_of(ours=trained(np.array([50.0])), theirs=trained(np.array([80.0]))), [NEARER], "last")
    )
    assert one.verdict == "-"
    assert judge_claims(results_of(), [NEARER], "last") == [None]


def test_every_verdict_states_seeds_interval_and_statistic() -> None:
    ours, theirs = draws(0.3)
    claim = next(claim for claim in CLAIMS if claim.ratio < 1)
    text = verdicts(results_of(**{claim.better: trained(ours), claim.worse: trained(theirs)}))
    # The training has evaluations up to 100 only: what is not there is not compared.
    assert "| 20 (0-19) |" not in text
    late = [
        [SeedResult(i, (Evaluation(claim.episode, 5.0, 1.0, e, e, 0.0),), {}, 1.0) for i, e in enumerate(side.tolist())]
        for side in (ours, theirs)
    ]
    text = verdicts(results_of(**{claim.better: late[0], claim.worse: late[1]}))
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {claim.text} ")]
    assert "| 20 (0-19) |" in line and line.count("ratio 0.3") == 2 and line.count(f"claimed <= {claim.ratio:.3f}") == 2
    assert line.count("[") == 4 and line.count("p < 0.001") == 2 and line.count("| holds |") == 2
    assert "last policy" in text.splitlines()[0] and "five best" in text.splitlines()[0]


def test_a_figure_aimed_at_is_reached_by_its_whole_interval_or_by_the_mean_alone() -> None:
    target = next(t for t in TARGETS if t.what == "error_mm")

    def verdict(mean: float, spread: float) -> str:
        errors = mean + spread * np.linspace(-1, 1, 20)
        found = [
            SeedResult(i, (Evaluation(target.episode, 5.0, 1.0, e, e, 0.0),), {}, 1.0)
            for i, e in enumerate(errors.tolist())
        ]
        (line,) = [x for x in targets_table(results_of(**{target.training: found})).splitlines() if target.title in x]
        return line.rsplit("|", 2)[1].strip()

    assert verdict(target.bound - 50, 10) == "yes"
    assert verdict(target.bound - 1, 50) == "the mean alone"
    assert verdict(target.bound + 5, 50) == "**no**"
