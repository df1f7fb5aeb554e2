"""The report on learning as Markdown with charts: the paper's figures beside ours, and what did not reproduce."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.charts import ChartLine, line_chart
from benchmarks.learning.plan import EXPLORATIONS, REWARDS, RIVALS, RULES, Counts, Experiment, rival_training
from benchmarks.learning.runs import (
    SPEED_MPS,
    Column,
    PlayedSeed,
    Results,
    SeedResult,
    at,
    at_end,
    five_best,
    paired,
    shown,
    table_of_trainings,
    values_at,
)
from core.learning.config import EnvironmentConfig
from core.learning.evaluation.policy_evaluator import PolicyEvaluator
from core.learning.runs.summary import baseline_row, spread_of
from core.metrics.score import binomial_interval
from core.text import markdown_table

RIVAL_NOTE = """Rivals get the case-based reward and the true state. `default`: the library's initial exploration.
`matched`: the noise of our agents (0.1 at the start) and a learning rate of 0.001; TD3 has both by default. TD3 and SAC
learn once per episode, as they come, the paper's agent four times.
Paper: at 5 m/s at least 35.8 % better than each, at 4 m/s at least 55.5 %.
"""


def against_rivals(results: Results) -> str:
    """PPO, A2C, TRPO, TD3 and SAC at 4 m/s, at 5 m/s, and with the same curriculum."""
    parts = ["## Against PPO, A2C, TRPO, TD3 and SAC\n"]
    for name, title, ours, episode, speed in (
        ("4", "4 m/s, 1,000 episodes", "reward-4-cdta", 1000, 4.0),
        ("5", "5 m/s; rivals 1,700 episodes straight at 5 m/s", "replay-threshold", 1700, 5.0),
        ("ladder", "5 m/s; everybody 800 episodes at 3 m/s, then 900", "replay-threshold", 1700, 5.0),
    ):
        agents = {"**paper's agent (DDPG, CDTA)**": ours}
        for exploration in EXPLORATIONS:
            agents |= {f"{one.upper()}, {exploration}": rival_training(name, exploration, one) for one in RIVALS}
        if name != "4":
            agents["landing model (beyond the paper)"] = "model-5"
        columns = {
            "returned, %": at(episode, "returned"),
            "error, mm": at(episode, "error_mm"),
            "error of returned, mm": at(episode, "error_returned_mm"),
            "missed, %": at(episode, "missed"),
            "five best, mm": five_best(speed),
        }
        parts.append(f"### {title}\n\n" + table_of_trainings(results, "agent", agents, columns))
    return "\n".join([*parts, RIVAL_NOTE])


MODEL_NOTE = """Labels of failed balls that a real robot could not see are masked, except where `privileged` is said.
`gravity known`: the critic predicts the velocity after the stroke, and the parabola is given. `law of reflection
known`: it predicts restitution and grip of the rubber and a small push, and reflection and parabola are given; the form
of physics is told, its numbers are learned. `Gaussian process`: no network predicts that velocity; the law of
reflection is learned, the parabola is given. `law of reflection fitted`: nor do networks here; the law's numbers are
found by least squares, and the actor is solved for.
"""
CHAIN_NOTE = """Nothing of the truth reaches the player here: a ball is served in the simulated world, two event cameras
(1280x720) see it, and the chain of detection, stereo and prediction gives the state on which the stroke is decided,
40 to 50 ms before the ball arrives; the racket has limited speed and acceleration and goes where the ball is expected.
What came of each training ball is told by the simulator. Every evaluated ball is played in that world to its end, the
last policy of each seed on the same balls. A ball that the racket did not meet counts 2.74 m.
"""
FORMATS: Final = ("g", "d", "d", "d", "", "", "", ".0f", ".0f")

_MODEL_ROWS: Final = {
    "5 m/s": "model-5",
    "5 m/s, with privileged labels of failed balls": "model-privileged",
    "5 m/s, predicted state": "model-predicted",
    "5 m/s, gravity known to the model": "model-flight-5",
    "5 m/s, Q critic: 16 updates on batches of 32, 3 relabelled targets, accuracy reward, 30 random": "better-300",
    "5 m/s, law of reflection known to the model": "model-impact-5",
    "5 m/s, Gaussian process": "model-process-5",
    "9 m/s, hard serves": "model-hard-9",
    "5 m/s, hard serves, noise 5 mm + 1 %": "model-hard-noisy-5",
    "9 m/s, hard serves, noise 5 mm + 1 %": "model-hard-noisy-9",
    "5 m/s, hard and noisy, law of reflection known": "model-impact-hard-noisy-5",
    "9 m/s, hard and noisy, law of reflection known": "model-impact-hard-noisy-9",
    "5 m/s, hard and noisy, Gaussian process": "model-process-hard-noisy-5",
    "9 m/s, hard and noisy, Gaussian process": "model-process-hard-noisy-9",
    "5 m/s, law of reflection fitted": "model-reflection-5",
    "5 m/s, hard and noisy, law of reflection fitted": "model-reflection-hard-noisy-5",
    "9 m/s, hard and noisy, law of reflection fitted": "model-reflection-hard-noisy-9",
    "5 m/s, 1 degree of random actuator error": "model-shaky",
    "5 m/s, 1 degree of random actuator error, law of reflection fitted": "model-reflection-shaky",
    "5 m/s, 1 degree of constant actuator bias": "model-biased",
}
_CLIMBS: Final = {
    "100 episodes each, retain": "model-climb-retain",
    "100 episodes each, discard": "model-climb-discard",
    "hard serves, noise 5 mm + 1 %, 200 each, retain": "model-hard-noisy-climb",
}


def landing_model(results: Results) -> str:
    """The agent whose critic predicts the landing."""
    columns = {
        ("50 episodes" if episode == 50 else str(episode)): _both(episode) for episode in (50, 100, 200, 300, 1700)
    }
    stages = {
        ("5 m/s" if speed == 5 else f"{speed:g}"): at_end(speed, "error_mm") for speed in (5.0, 6.0, 7.0, 8.0, 9.0)
    }
    parts = [
        "## Beyond: the landing-model agent\n",
        table_of_trainings(results, "returned, error in mm after", _MODEL_ROWS, columns),
        MODEL_NOTE,
        "Ladders, at the end of each stage:\n",
        table_of_trainings(results, "", _CLIMBS, stages),
    ]
    straight = results["model-5"]
    for name in sorted({name for result in straight for name in result.transfers}):
        moved = [result.transfers[name] for result in straight]
        parts.append(
            f"- trained 1,700 episodes with an exact racket, evaluated with {name}: "
            f"{shown('returned', [e.returned for e in moved])} % returned, "
            f"{shown('error_mm', [e.error_mm for e in moved])} mm"
        )
    return "\n".join(parts) + "\n"


def _both(episode: int) -> Column:
    def say(found: Sequence[SeedResult]) -> str:
        returned = values_at(found, episode, "returned")
        error = shown("error_mm", values_at(found, episode, "error_mm"))
        return f"{100 * sum(returned) / len(returned):.1f} %, {error}" if returned else ""

    return say


def event_cameras(played: Sequence[PlayedSeed], counts: Counts) -> str:
    """The task with the whole chain in the loop; empty if it was not run."""
    if not played:
        return ""
    errors_mm = np.concatenate([one.score.counted_mm for one in played])
    row = [
        SPEED_MPS,
        len(played),
        counts.event_episodes,
        counts.event_balls,
        shown("returned", [one.score.return_rate for one in played]),
        shown("missed", [one.score.missed for one in played]),
        shown("error_mm", [one.score.error_mm for one in played]),
        float(np.median(errors_mm)),
        float(np.percentile(errors_mm, 95)),
    ]
    titles = ("m/s", "seeds", "training balls", "evaluation balls", "returned, % (aimed at: 90)", "missed, %")
    titles += ("error, mm, last policy", "median of all balls", "95 %")
    return "## With event cameras in the loop\n\n" + CHAIN_NOTE + "\n" + markdown_table(titles, [row], FORMATS)


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


CURVES_HEADING = "## Curves\n"
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
paper shows its figures. Up to {seeds} seeds from 0 on, rivals included, and {minor} for variants;
the tables say how many there are. Development looked at these seeds, so they show no claim: what the paper claims is
tested [on drawn seeds](#the-papers-claims). Seeds have the same balls in every training, so differences are paired,
and what has not the same seeds is not compared. Agents called paper perceive by the five-point prediction, all others
know the true state. (With the exact positions that the simulator gives, and gravity alone, five points after the bounce
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
        _baselines(counts),
        _rewards(results),
        _replay(results),
        against_rivals(results),
        landing_model(results),
        event_cameras(played, counts),
        *sections,
        "## Curves\n\nMean over seeds with its 95 % interval.\n",
        *(f"![{name}](images/learning-{name}.svg)\n" for name in CHARTS),
    ]
    path.write_text("\n".join(parts), encoding="utf-8")
    draw_learning_charts(results, path.parent / "images")


def replace_section(path: Path, section: str) -> None:
    """Put a section, which begins with its heading, in the place of the old one, or before the curves.

    The rest of the page stays as it is.
    """
    heading = section.partition("\n")[0]
    text = path.read_text(encoding="utf-8") if path.exists() else "# Learning to return: what was measured\n"
    found = text.find(f"{heading}\n")
    start = found if found >= 0 else text.find(CURVES_HEADING)
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
