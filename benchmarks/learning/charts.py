"""The report's charts: mean over seeds with its 95 % interval, at every evaluation of a training."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from benchmarks.charts import ChartLine, line_chart
from benchmarks.learning.plan import REWARDS, RIVALS, RULES
from benchmarks.learning.runs import Results, SeedResult, values_at
from core.learning.runs.summary import spread_of


def _rivals(name: str, ours: str) -> dict[str, str]:
    return {"paper's agent": ours} | {agent.upper(): f"rival-{name}-matched-{agent}" for agent in RIVALS}


_RULES: Final = {rule: f"replay-{rule}" for rule in (*RULES, "scratch")}
_MODELS: Final = {
    "Q critic, improved": "better-300",
    "gravity known": "model-flight-5",
    "reflection known": "model-impact-5",
    "privileged labels": "model-privileged",
    "1 degree of bias": "model-biased",
}
CHARTS: Final = {
    "rewards-error": ("Three rewards at 4 m/s", "error_mm", 800.0, {kind: f"reward-4-{kind}" for kind in REWARDS}),
    "rewards-returned": ("Three rewards at 3 m/s, the paper's pace", "returned", 100.0,
                         {kind: f"reward-slow-3-{kind}" for kind in REWARDS}),
    "replay-error": ("Replay rules: 3 then 5 m/s", "error_mm", 800.0, _RULES),
    "replay-returned": ("Replay rules: 3 then 5 m/s", "returned", 100.0, _RULES),
    "rivals-4": ("4 m/s, matched exploration", "error_mm", 800.0, _rivals("4", "reward-4-cdta")),
    "rivals-5": ("5 m/s, matched exploration", "error_mm", 800.0,
                 _rivals("5", "replay-threshold") | {"landing model": "model-5"}),
    "rivals-ladder": ("3 then 5 m/s, matched exploration", "error_mm", 800.0, _rivals("ladder", "replay-threshold")),
    "model": ("Landing model and improved Q critic, 5 m/s", "error_mm", 120.0, _MODELS),
}  # fmt: skip
"""Title, what is drawn, the top of the chart, and the training of every line."""


def draw_learning_charts(results: Results, folder: Path) -> None:
    """Each chart as a file of its name."""
    for name, (title, what, top, trainings) in CHARTS.items():
        lines = [curve(words, results[training], what) for words, training in trainings.items() if results[training]]
        y_title = "returned, %" if what == "returned" else "error, mm"
        line_chart(folder / f"learning-{name}.svg", title, "episode", y_title, lines, y_top=top)


def curve(name: str, results: Sequence[SeedResult], what: str) -> ChartLine:
    """Mean and 95 % interval at every evaluation."""
    episodes = sorted({e.episode for result in results for e in result.evaluations})
    scale = 100.0 if what == "returned" else 1.0
    spreads = [spread_of([scale * value for value in values_at(results, episode, what)]) for episode in episodes]
    kept = [(episode, s) for episode, s in zip(episodes, spreads, strict=True) if s.count]
    low = [s.mean if math.isnan(s.low) else s.low for _, s in kept]
    high = [s.mean if math.isnan(s.high) else s.high for _, s in kept]
    return ChartLine(name, [episode for episode, _ in kept], [s.mean for _, s in kept], low, high)
