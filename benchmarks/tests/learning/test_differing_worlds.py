"""The tables about differing worlds: which policy was played where."""

from collections import defaultdict

from benchmarks.learning.differing_worlds import ALL, HOME, MUJOCO, RACKET, differing_tables, trainings
from benchmarks.learning.runs import Evaluation, Results, SeedResult
from core.learning.randomisation import RANDOMISED

ELSEWHERE = (*RANDOMISED, ALL, RACKET, MUJOCO)


def evaluation(error_mm: float) -> Evaluation:
    return Evaluation(12, 5.0, 1.0, error_mm, error_mm, 0.0)


def test_the_one_trained_at_home_plays_everywhere_and_all_others_at_home() -> None:
    home, *others = trainings(first_seed=3, seeds=2, episodes=12, balls=4)
    assert home.name == HOME and tuple(one.name for one in others) == ELSEWHERE
    assert dict(home.transfers) == {one.name: one.config.environment for one in others}
    assert all(one.transfers == ((HOME, home.config.environment),) for one in others)
    assert dict(home.transfers)[ALL].randomise.names == RANDOMISED
    assert dict(home.transfers)[RACKET].racket == "uncertain"


def test_a_row_has_what_each_policy_did_in_both_worlds_and_the_paired_differences() -> None:
    results: Results = defaultdict(list)
    for seed in (3, 4):
        there = {name: evaluation(50.0 + seed) for name in ELSEWHERE}
        results[HOME].append(SeedResult(seed, (evaluation(10.0 + seed),), there, 1.0))
        for name in ELSEWHERE:
            at_home = {HOME: evaluation(20.0 + 2 * seed)}
            results[name].append(SeedResult(seed, (evaluation(40.0 + seed),), at_home, 1.0))
    errors = next(line for line in differing_tables(results)[1].splitlines() if line.startswith("| rubber"))
    cells = [cell.split(" ±")[0].split(" [")[0] for cell in errors.strip("| ").split(" | ")]
    assert cells == ["rubber", "13.5", "27.0", "+13.5", "54", "44", "-10.0"]
