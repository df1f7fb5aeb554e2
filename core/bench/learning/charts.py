"""The report's charts: mean over seeds with its 95 % interval, at every evaluation of a training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from core.bench.learning.plan import REWARDS, RIVALS, RULES
from core.bench.learning.runs import SeedResult
from core.bench.learning.tables import curve
from core.bench.line_chart import ChartLine, line_chart

Results = Mapping[str, Sequence[SeedResult]]

HIGHEST_MM, HIGHEST_MODEL_MM, HIGHEST_PERCENT = 800.0, 120.0, 100.0


def learning_charts(results: Results) -> dict[str, str]:
    """Each chart as SVG, by name."""

    def lines(named: Mapping[str, str], what: str) -> list[ChartLine]:
        return [curve(title, results[name], what) for name, title in named.items() if results.get(name)]

    def errors(title: str, named: Mapping[str, str], top: float = HIGHEST_MM) -> str:
        return line_chart(title, "episode", "error, mm", lines(named, "error_mm"), y_top=top)

    def returns(title: str, named: Mapping[str, str]) -> str:
        return line_chart(title, "episode", "returned, %", lines(named, "returned"), y_top=HIGHEST_PERCENT)

    def rivals(name: str, ours: str) -> dict[str, str]:
        return {ours: "paper's agent"} | {f"rival-{name}-matched-{agent}": agent.upper() for agent in RIVALS}

    rules = {f"replay-{rule}": rule for rule in (*RULES, "scratch")}
    model = {"model-5": "landing model"}
    return {
        "rewards-error": errors("Three rewards at 4 m/s", {f"reward-4-{kind}": kind for kind in REWARDS}),
        "rewards-returned": returns(
            "Three rewards at 3 m/s, the paper's pace", {f"reward-slow-3-{kind}": kind for kind in REWARDS}
        ),
        "replay-error": errors("Replay rules: 3 then 5 m/s", rules),
        "replay-returned": returns("Replay rules: 3 then 5 m/s", rules),
        "rivals-4": errors("4 m/s, matched exploration", rivals("4", "reward-4-cdta")),
        "rivals-5": errors("5 m/s, matched exploration", rivals("5", "replay-threshold") | model),
        "rivals-ladder": errors("3 then 5 m/s, matched exploration", rivals("ladder", "replay-threshold")),
        "model": errors(
            "Landing model and improved Q critic, 5 m/s",
            {
                "better-300": "Q critic, improved",
                "model-flight-5": "gravity known",
                "model-impact-5": "reflection known",
            }
            | {"model-privileged": "privileged labels", "model-biased": "1 degree of bias"},
            HIGHEST_MODEL_MM,
        ),
    }
