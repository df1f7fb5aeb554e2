"""The report on learning as Markdown with charts: the paper's figures beside ours, and what did not reproduce."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.charts import ChartLine, line_chart
from benchmarks.learning.beyond import event_cameras, landing_model, timings, tried
from benchmarks.learning.contests import against_rivals, both_timings, variants
from benchmarks.learning.event_runs import PlayedSeed
from benchmarks.learning.plan import REWARDS, RIVALS, RULES, Counts, Experiment
from benchmarks.learning.runs import Results, SeedResult, values_at
from benchmarks.learning.tables import at, five_best, paired, shown
from benchmarks.learning.verdicts import noise_floor, verdicts
from core.learning.config import EnvironmentConfig
from core.learning.evaluation.policy_evaluator import PolicyEvaluator
from core.learning.runs.summary import baseline_row, spread_of
from core.metrics.intervals import binomial_interval
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


TIME_HEADING = "## Time\n"
PAPER_RETURNS = {
    ("3", 350): (46, 70, 78),
    ("3", 400): (86, 80, 98),
    ("3", 600): (92, 98, 100),
    ("4", 600): (46, 60, 72),
    ("4", 800): (60, 80, 92),
    ("4", 900): (60, 82, 98),
}
"""Return rate in percent under the simple, case-based and CDTA reward (the paper's table)."""
PAPER_BALLS = 50
"""The paper's rates are all even numbers: consistent with this many balls."""
HEADER = """# Learning to return: what was measured

Made by `rallyscope bench learning`. One episode is one serve and one racket orientation. Every policy is evaluated
without noise on the same {balls} balls per speed, which no training sees; the landing error is the distance to the
target of the landing extrapolated to the table's plane, over all balls, where one that the racket did not meet counts
2.74 m, the table's length. Figures are the *last* policy of each seed: mean ± standard deviation over seeds [95 %
interval of the mean]; *five best* is the mean of the five lowest of a seed's evaluations every 50 episodes, as the
paper shows its figures. Up to {seeds} seeds, rivals included, and {minor} for variants that nothing is claimed of;
the tables say how many there are. Seeds have the same balls in every training, so differences are paired, and what
has not the same seeds is not compared. Agents called paper perceive by the five-point prediction, all others know the
true state. (With the exact positions that the simulator gives, and gravity alone, five points after the bounce
determine the state: the prediction then *is* the truth, and both give the same figures. The rows called noisy show
what errors cost.) The racket stands upright at action zero and has one speed per serve speed.

Machine: {machine}.

The paper gives neither seeds nor several things that decide the difficulty (base orientation, racket speed, spread of
the targets). Its figures stand beside ours for orientation; equal numbers would not mean equal tasks.
"""


def write_learning_report(
    path: Path,
    experiments: Sequence[Experiment],
    results: Results,
    counts: Counts,
    machine: Mapping[str, object],
    played: Sequence[PlayedSeed] = (),
    sections: Sequence[str] = (),
) -> None:
    """Write the report and its charts with whatever results there are.

    `played`: seeds before event cameras. `sections`: of the report that can be made alone, each with its heading.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    about = ", ".join(f"{name} {value}" for name, value in machine.items() if name != "load")
    parts = [
        HEADER.format(balls=counts.balls, seeds=counts.seeds, minor=counts.minor_seeds, machine=about),
        "## The figures aimed at\n",
        targets_table(results),
        noise_floor(counts.balls),
        "## What reproduced and what did not\n",
        verdicts(results),
        _baselines(counts),
        _rewards(results),
        _replay(results),
        both_timings(results),
        against_rivals(results),
        variants(results),
        landing_model(results),
        tried(results),
        event_cameras(played, counts),
        *sections,
        timings(experiments, results),
        "## Curves\n\nMean over seeds with its 95 % interval.\n",
        *(f"![{name}](images/learning-{name}.svg)\n" for name in CHARTS),
    ]
    path.write_text("\n".join(parts), encoding="utf-8")
    draw_learning_charts(results, path.parent / "images")


def replace_section(path: Path, section: str) -> None:
    """Put a section, which begins with its heading, in the place of the report's own; before the time if there is none.

    The rest of the page stays as it is.
    """
    heading = section.partition("\n")[0]
    text = path.read_text(encoding="utf-8") if path.exists() else "# Learning to return: what was measured\n"
    found = text.find(f"{heading}\n")
    start = found if found >= 0 else text.find(TIME_HEADING)
    start = len(text) if start < 0 else start
    end = text.find("\n## ", start + 1) + 1 if found >= 0 else start
    path.parent.mkdir(parents=True, exist_ok=True)
    before, after = text[:start].rstrip() + "\n\n", "" if end == 0 else text[end:]
    path.write_text(before + section.rstrip() + "\n" + (after and "\n" + after), encoding="utf-8")


def _baselines(counts: Counts) -> str:
    """What costs nothing, at every speed."""
    environment = EnvironmentConfig(state_source="truth")
    evaluator = PolicyEvaluator(environment, counts.balls)
    rows = []
    for speed in (3.0, 4.0, 5.0, 7.0, 9.0):
        row = baseline_row(evaluator, speed, environment)
        cells = [f"{speed:g}"]
        for name in ("zero", "random", "oracle"):
            score = row[name]
            assert isinstance(score, dict)
            cells.append(f"{100 * score['returned']:.0f} %, {score['error_mm']:.0f} mm")
        centre = row["constant_centre"]
        assert isinstance(centre, dict)
        rows.append([*cells, f"{centre['error_mm']:.0f} mm"])
    titles = ("m/s", "zero action", "random action", "oracle (best angles per ball)", "always the box's centre")
    return "## Without learning\n\n" + markdown_table(titles, rows)


def _rewards(results: Results) -> str:
    parts = ["## The three rewards\n"]
    for name, setting in (("", "our settings"), ("slow-", "the paper's pace: two updates, both rates at 0.001")):
        rows = []
        for (speed, episode), theirs in PAPER_RETURNS.items():
            runs = [results[f"reward-{name}{speed}-{kind}"] for kind in REWARDS]
            low, high = binomial_interval(theirs[2] / 100, PAPER_BALLS)
            rows.append(
                [
                    f"{speed} m/s @{episode}",
                    " / ".join(map(str, theirs)) + f" (last one [{100 * low:.0f}, {100 * high:.0f}] if of 50 balls)",
                    *map(at(episode, "returned"), runs),
                    paired(runs[2], runs[1], episode, "returned"),
                ]
            )
        titles = ("", "paper: simple / case / CDTA, %", "simple, %", "case, %", "CDTA, %", "CDTA - case")
        seeds = len(results[f"reward-{name}4-cdta"])
        parts.append(f"Return rate, {setting} ({seeds} seeds):\n\n" + markdown_table(titles, rows))
        rows = []
        for episode in (400, 600, 800, 1000):
            runs = [results[f"reward-{name}4-{kind}"] for kind in REWARDS]
            rows.append(
                [str(episode), *map(at(episode, "error_mm"), runs), paired(runs[2], runs[1], episode, "error_mm")]
            )
        parts.append(
            f"Landing error in mm at 4 m/s, {setting} (paper, CDTA @1000: 226):\n\n"
            + markdown_table(("episode", "simple", "case", "CDTA", "CDTA - case"), rows)
        )
    return "\n".join(parts)


def _replay(results: Results) -> str:
    """3 then 5 m/s under the replay rules, and 5 m/s from scratch with the same number of episodes."""
    rows = []
    for rule in (*RULES, "scratch"):
        found = results[f"replay-{rule}"]
        before = 0 if rule == "scratch" else 800
        columns = [
            at(before + 50, "returned"),
            at(before + 100, "returned"),
            at(1700, "returned"),
            at(1700, "error_mm"),
        ]
        worst = max(values_at(found, 1700, "error_mm"), default=None)
        rows.append([rule, len(found), *(say(found) for say in columns), worst, five_best(5.0)(found)])
    titles = ("rule", "seeds", "returned +50 ep, %", "+100 ep, %", "@1700, %")
    titles += ("error @1700, mm", "worst seed", "five best, mm")
    ours = results["replay-threshold"]
    lines = [
        "## Replay rules and curriculum: 800 episodes at 3 m/s, then 900 at 5 m/s\n",
        markdown_table(titles, rows, ("", "d", "", "", "", "", ".0f")),
        "Paper: 277 mm @1700 with threshold, by the five best evaluations, and threshold best of all.\n",
        "Paired differences of the error @1700 in mm:\n",
        *(
            f"- threshold - {rule}: {paired(ours, results[f'replay-{rule}'], 1700, 'error_mm')}"
            for rule in ("retain", "discard", "scratch")
        ),
    ]
    return "\n".join(lines) + "\n"
