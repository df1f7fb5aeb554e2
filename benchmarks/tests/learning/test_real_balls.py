"""The part of the report about real balls: made alone, resumed, and the rest of the page left as it is."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from benchmarks.learning import bench_learning
from benchmarks.learning import runs as learning_runs
from benchmarks.learning.plan import Counts, plan
from benchmarks.learning.real_balls import built_in_score, real_experiments, real_rows
from benchmarks.learning.report import replace_section
from benchmarks.learning.runs import fingerprint
from core.errors import ConfigError
from core.jobs import ALONE
from core.learning.config import environment_profile, spinning_environment
from core.learning.evaluation.policy_evaluator import landing_errors_mm, oracle_actions
from core.learning.task.environment import evaluation_balls, play
from tests.core.learning.task.test_recorded_balls import write_states

TINY = Counts(seeds=2, minor_seeds=1, balls=4, shorten=150, event_seeds=1, people_balls=2)
PAGE = "# Page\n\nabove\n\n## Real balls\n\nold\n\n## Curves\n\nbelow\n"


def test_it_is_made_alone_and_not_trained_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    balls = write_states(tmp_path / "people.json", 600)
    where = {"folder": tmp_path / "kept", "report": page, "counts": TINY, "engine": ALONE}
    asked = where | {"only": "real-balls", "recorded": str(balls)}
    first = bench_learning.run(lambda share: None, **asked)  # type: ignore[arg-type]
    text = page.read_text()
    assert text.startswith("# Page\n\nabove\n\n## Real balls\n") and text.endswith("\n\n## Curves\n\nbelow\n")
    assert "\n\nold\n" not in text and text.count("## Real balls") == 1
    (seen,) = [line for line in text.splitlines() if line.startswith("| before the event cameras |")]
    assert "| 1 |" in seen and ">= 95 %, <= 200 mm" in seen
    for words in ("`people.json`", "*built-in*", "*limit*", ">= 99 %, <= 60 mm", ">= 97 %, median <= 120 mm", "| 2 |"):
        assert words in text

    def never(*_: object) -> None:
        raise AssertionError("done again")

    monkeypatch.setattr(learning_runs, "run_training", never)
    monkeypatch.setattr("benchmarks.learning.real_balls.oracle_actions", never)
    assert bench_learning.run(lambda share: None, **asked)["rows"] == first["rows"]  # type: ignore[arg-type]
    assert page.read_text() == text
    with pytest.raises(ConfigError, match="no such part"):
        bench_learning.run(lambda share: None, **where, only="everything")  # type: ignore[arg-type]


def test_without_recorded_balls_their_table_says_so(tmp_path: Path) -> None:
    assert not [row for row in real_rows(None) if row.name.startswith("human")]
    page = tmp_path / "new" / "page.md"
    where = {"folder": tmp_path / "kept", "report": page, "counts": dataclasses.replace(TINY, seeds=1), "engine": ALONE}
    bench_learning.run(lambda share: None, **where, only="real-balls")  # type: ignore[arg-type]
    assert "Balls of human play: not measured" in page.read_text()


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (PAGE, "# Page\n\nabove\n\n## Real balls\n\nnew\n\n## Curves\n\nbelow\n"),
        ("# Page\n\n## Curves\n\nbelow\n", "# Page\n\n## Real balls\n\nnew\n\n## Curves\n\nbelow\n"),
        ("# Page\n\n## Real balls\n\nold\n", "# Page\n\n## Real balls\n\nnew\n"),
        ("# Page\n\nabove\n", "# Page\n\nabove\n\n## Real balls\n\nnew\n"),
    ],
)
def test_a_section_takes_the_place_of_its_own(before: str, after: str, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(before)
    for _ in range(2):
        replace_section(page, "## Real balls\n\nnew\n")
        assert page.read_text() == after


def test_goals_are_over_five_seeds_of_real_physics_and_known_spin() -> None:
    found = {one.name: one.config for one in real_experiments(Counts(), "/somewhere/balls.json")}
    for name in ("real-spin", "real-within", "real-human"):
        config = found[name]
        assert (config.seeds, config.first_seed, config.environment.state) == (5, 0, "spin")
        assert config.environment.state_source == "truth" and config.environment.task.physics.has_air
    assert found["real-spin"].episodes == 300 and found["real-spin"].evaluation_balls == 500
    most = found["real-within"].environment.task.serve.spin_spread_radps
    assert 99 < np.sqrt(3) * most <= 100.1


def test_a_setting_that_came_later_leaves_earlier_results_their_names(tmp_path: Path) -> None:
    """Whoever measured before must not have to measure again."""
    before = {e.name: fingerprint(e.config) for e in plan(Counts())}
    assert (before["reward-3-simple"], before["reward-4-simple"]) == ("43e35ed3f4", "06fcf070c0")
    balls = write_states(tmp_path / "a.json", 5)
    (config,) = [e.config for e in real_experiments(Counts(), str(balls)) if e.name == "real-human"]
    name = fingerprint(config)
    moved = balls.rename(tmp_path / "b.json")
    recorded = dataclasses.replace(config.environment, recorded=str(moved))
    assert fingerprint(dataclasses.replace(config, environment=recorded)) == name, "the balls count, not their place"
    write_states(moved, 6)
    assert fingerprint(dataclasses.replace(config, environment=recorded)) != name


def test_the_built_in_controller_and_the_limit_hit_the_same_targets() -> None:
    config = spinning_environment(environment_profile("real", state_source="truth"))
    config = dataclasses.replace(config, state="spin", racket="chosen")
    balls = evaluation_balls(5.0, 12, config)
    built_in = built_in_score(balls, config)
    best = play(balls, oracle_actions(balls, config), config)
    assert built_in.return_rate == 1 and best.returned.all()
    assert np.median(built_in.errors_mm) < 5
    assert np.median(landing_errors_mm(best, balls.goals_m)) < 15
    assert landing_errors_mm(best, balls.goals_m).mean() < built_in.error_mm + 5
