"""The figures that the agents are to reach, and whether they do: of the last policy, with its interval over seeds."""

from __future__ import annotations

import math
from dataclasses import dataclass

from benchmarks.learning.runs import Results, values_at
from benchmarks.learning.tables import shown
from core.learning.runs.summary import spread_of
from core.text.markdown_table import markdown_table


@dataclass(frozen=True, slots=True)
class Target:
    """A bound on a figure of a training."""

    title: str
    training: str
    episode: int
    what: str
    """returned (at least) or error_mm (at most)."""
    bound: float


TARGETS = (
    Target("paper's agent, 3 m/s, returned @600", "reward-3-cdta", 600, "returned", 0.99),
    Target("paper's agent, 4 m/s, returned @900", "reward-4-cdta", 900, "returned", 0.98),
    Target("paper's agent, 4 m/s, error @1000", "reward-4-cdta", 1000, "error_mm", 226.0),
    Target("paper's agent, 3 then 5 m/s, error @1700", "replay-threshold", 1700, "error_mm", 150.0),
    Target("Q critic improved, 5 m/s, returned @300", "better-300", 300, "returned", 0.99),
    Target("Q critic improved, 5 m/s, error @300", "better-300", 300, "error_mm", 100.0),
    Target("landing model, 5 m/s, returned @50", "model-5", 50, "returned", 0.99),
    Target("landing model, 5 m/s, error @50", "model-5", 50, "error_mm", 50.0),
    Target("landing model, 5 m/s, error @100", "model-5", 100, "error_mm", 25.0),
    Target("landing model, 5 m/s, error @1700", "model-5", 1700, "error_mm", 12.0),
    Target("landing model, 100 a stage, error at 9 m/s", "model-climb-retain", 500, "error_mm", 20.0),
    Target("landing model, hard and noisy, 5 m/s, error @200", "model-hard-noisy-5", 200, "error_mm", 60.0),
    Target("landing model, hard and noisy, 9 m/s, error @200", "model-hard-noisy-9", 200, "error_mm", 60.0),
    Target("law of reflection fitted, the same @200", "model-reflection-hard-noisy-9", 200, "error_mm", 66.0),
    Target("law of reflection fitted, 1 degree of random error @300", "model-reflection-shaky", 300, "error_mm", 75.0),
)


NOTE = """
*Reached*: yes, if the whole 95 % interval of the mean over seeds is within the bound; *the mean alone*, if only that.

"""


def targets_table(results: Results) -> str:
    """Each figure, what was found, and whether the mean over seeds reaches it, with its whole interval or alone."""
    rows = []
    for target in TARGETS:
        values = values_at(results[target.training], target.episode, target.what)
        is_rate = target.what == "returned"
        aimed = f">= {100 * target.bound:g} %" if is_rate else f"<= {target.bound:g} mm"
        spread = spread_of(values)
        reached = _reaches(spread.mean, target)
        whole = reached and _reaches(spread.low if is_rate else spread.high, target)
        verdict = "-" if math.isnan(spread.mean) else "yes" if whole else "the mean alone" if reached else "**no**"
        rows.append([target.title, aimed, shown(target.what, values), str(len(values)), verdict])
    titles = ("figure", "aimed at", "last policy, mean ± sd [95 %]", "seeds", "reached")
    return markdown_table(titles, rows) + NOTE


def _reaches(value: float, target: Target) -> bool:
    return value >= target.bound if target.what == "returned" else value <= target.bound
