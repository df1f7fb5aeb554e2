"""The report on learning as Markdown with charts: the paper's figures beside ours, and what did not reproduce."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from core.evaluation.learning_plan import EXPLORATIONS, RIVALS, RULES, Counts, Experiment, rival_training
from core.evaluation.learning_runs import SeedResult
from core.evaluation.learning_tables import at, binomial_interval, curve, millimetres, paired, percent, table
from core.evaluation.learning_targets import targets_table
from core.evaluation.learning_verdicts import noise_floor, verdicts
from core.evaluation.line_chart import Line, line_chart
from core.learning.config import EnvironmentConfig
from core.learning.scoring import Examiner
from core.learning.summary import baseline_row

Results = Mapping[str, Sequence[SeedResult]]

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
target of the landing extrapolated to the table's plane, over all balls that the racket met. Figures are the *last*
policy of each seed: mean ± standard deviation over seeds [95 % interval of the mean]. {seeds} seeds, {minor} for
variants and {rivals} for rivals; seeds have the same balls in every training, so differences are paired. Agents called
paper perceive by the five-point prediction, all others know the true state. The racket stands upright at action zero
and has one speed per serve speed. Machine: {machine}.

The paper gives neither seeds nor several things that decide the difficulty (base orientation, racket speed, spread of
the targets). Its figures stand beside ours for orientation; equal numbers would not mean equal tasks.
"""

RIVAL_NOTE = """`default`: the library's initial exploration. `matched`: the noise of our agents (0.1 at the start) and
a learning rate of 0.001; TD3 has both by default. TD3 and SAC learn once per episode, as they come, the paper's agent
four times.
Paper: at 5 m/s at least 35.8 % better than each, at 4 m/s at least 55.5 %.
"""


def write_report(path: Path, experiments: Sequence[Experiment], results: Results, counts: Counts, machine: str) -> None:
    """Write the report and its charts with whatever results there are."""
    path.parent.mkdir(parents=True, exist_ok=True)
    parts = [
        HEADER.format(
            balls=counts.balls, seeds=counts.seeds, rivals=counts.rival_seeds, minor=counts.minor_seeds, machine=machine
        ),
        "## The figures aimed at\n",
        targets_table(results),
        noise_floor(counts.balls),
        "## What reproduced and what did not\n",
        verdicts(results),
        _baselines(counts),
        _rewards(results),
        _replay(results),
        _against_rivals(results),
        _variants(results),
        _landing_model(results),
        _timings(experiments, results),
    ]
    charts = path.parent / "learning-report"
    charts.mkdir(exist_ok=True)
    for name, chart in _charts(results).items():
        (charts / f"{name}.svg").write_text(chart, encoding="utf-8")
        parts.append(f"![{name}](learning-report/{name}.svg)\n")
    path.write_text("\n".join(parts), encoding="utf-8")


def _baselines(counts: Counts) -> str:
    """What costs nothing, at every speed."""
    environment = EnvironmentConfig(state_source="truth")
    examiner = Examiner(environment, counts.balls)
    rows = []
    for speed in (3.0, 4.0, 5.0, 7.0, 9.0):
        row = baseline_row(examiner, speed, environment)
        cells = [f"{speed:g}"]
        for name in ("zero", "random", "oracle"):
            score = row[name]
            assert isinstance(score, dict)
            cells.append(f"{100 * score['returned']:.0f} %, {score['error_mm']:.0f} mm")
        centre = row["constant_centre"]
        assert isinstance(centre, dict)
        rows.append([*cells, f"{centre['error_mm']:.0f} mm"])
    titles = ("m/s", "zero action", "random action", "oracle (best angles per ball)", "always the box's centre")
    return "## Without learning\n\n" + table(titles, rows)


def _rewards(results: Results) -> str:
    parts = ["## The three rewards\n"]
    for name, setting in (("", "our settings"), ("slow-", "the paper's pace: two updates, both rates at 0.001")):
        rows = []
        for (speed, episode), theirs in PAPER_RETURNS.items():
            runs = [results.get(f"reward-{name}{speed}-{kind}", ()) for kind in ("simple", "case", "cdta")]
            low, high = binomial_interval(theirs[2] / 100, PAPER_BALLS)
            rows.append(
                [
                    f"{speed} m/s @{episode}",
                    " / ".join(map(str, theirs)) + f" (last one [{100 * low:.0f}, {100 * high:.0f}] if of 50 balls)",
                    *(at(run, episode, "returned") for run in runs),
                    paired(runs[2], runs[1], episode, "returned"),
                ]
            )
        titles = ("", "paper: simple / case / CDTA, %", "simple, %", "case, %", "CDTA, %", "CDTA - case")
        parts.append(f"Return rate, {setting}:\n\n" + table(titles, rows))
        rows = []
        for episode in (400, 600, 800, 1000):
            runs = [results.get(f"reward-{name}4-{kind}", ()) for kind in ("simple", "case", "cdta")]
            cells = [at(run, episode, "error_mm") for run in runs]
            rows.append([str(episode), *cells, paired(runs[2], runs[1], episode, "error_mm")])
        parts.append(
            f"Landing error in mm at 4 m/s, {setting} (paper, CDTA @1000: 226):\n\n"
            + table(("episode", "simple", "case", "CDTA", "CDTA - case"), rows)
        )
    return "\n".join(parts)


def _replay(results: Results) -> str:
    """3 then 5 m/s under the replay rules, and 5 m/s from scratch with the same number of episodes."""
    rows = []
    for rule in (*RULES, "scratch"):
        found = results.get(f"replay-{rule}", ())
        early = [at(found, 800 + n, "returned") if rule != "scratch" else at(found, n, "returned") for n in (50, 100)]
        five = millimetres([result.five_best_mm(5.0) for result in found])
        rows.append([rule, *early, at(found, 1700, "returned"), at(found, 1700, "error_mm"), five])
    titles = ("rule", "returned +50 ep, %", "+100 ep, %", "@1700, %", "error @1700, mm", "five best, mm")
    retain, discard = results.get("replay-retain", ()), results.get("replay-discard", ())
    threshold, scratch = results.get("replay-threshold", ()), results.get("replay-scratch", ())
    lines = [
        "## Replay rules and curriculum: 800 episodes at 3 m/s, then 900 at 5 m/s\n",
        table(titles, rows),
        "Paper: 277 mm @1700 with threshold, by the five best evaluations, and threshold best of all.\n",
        "Paired differences of the error @1700 in mm:\n",
        f"- threshold - retain: {paired(threshold, retain, 1700, 'error_mm')}",
        f"- threshold - discard: {paired(threshold, discard, 1700, 'error_mm')}",
        f"- threshold - scratch: {paired(threshold, scratch, 1700, 'error_mm')}\n",
    ]
    return "\n".join(lines)


def _against_rivals(results: Results) -> str:
    parts = ["## Against PPO, A2C, TRPO, TD3 and SAC\n"]
    for name, title, ours, episode, speed in (
        ("4", "4 m/s, 1,000 episodes", "reward-4-cdta", 1000, 4.0),
        ("5", "5 m/s; rivals 1,700 episodes straight at 5 m/s", "replay-threshold", 1700, 5.0),
        ("ladder", "5 m/s; everybody 800 episodes at 3 m/s, then 900", "replay-threshold", 1700, 5.0),
    ):
        rows = [_rival_row("**paper's agent (DDPG, CDTA)**", results.get(ours, ()), episode, speed)]
        for exploration in EXPLORATIONS:
            for agent in RIVALS:
                found = results.get(rival_training(name, exploration, agent), ())
                rows.append(_rival_row(f"{agent.upper()}, {exploration}", found, episode, speed))
        if name != "4":
            rows.append(_rival_row("landing model (beyond the paper)", results.get("model-5", ()), 1700, 5.0))
        titles = ("agent", "seeds", "returned, %", "error, mm", "error of returned, mm", "five best, mm")
        parts.append(f"### {title}\n\n" + table(titles, rows))
    return "\n".join([*parts, RIVAL_NOTE])


def _rival_row(name: str, found: Sequence[SeedResult], episode: int, speed: float) -> list[str]:
    returned, error = at(found, episode, "returned"), at(found, episode, "error_mm")
    five = millimetres([result.five_best_mm(speed) for result in found])
    return [name, str(len(found)), returned, error, at(found, episode, "error_returned_mm"), five]


def _variants(results: Results) -> str:
    rows = []
    for name, title in (
        ("replay-threshold", "as it stands: y = r, random targets, predicted state, 4 updates"),
        ("variant-bootstrap", "bootstrapped target: y = r + 0.9 Q'(s', g, mu'(s', g)), the paper's equation"),
        ("variant-fixed-target", "one fixed target, the box's centre"),
        ("variant-true-state", "the true state"),
        ("variant-slow", "2 updates per episode, both rates at 0.001"),
        ("variant-equal-rates", "4 updates per episode, both rates at 0.001"),
    ):
        found = results.get(name, ())
        rows.append([title, at(found, 600, "returned"), at(found, 1700, "returned"), at(found, 1700, "error_mm")])
    text = "## What the paper leaves open\n\nThe curriculum of 3 then 5 m/s:\n\n"
    text += table(("variant", "returned @600 (3 m/s), %", "@1700 (5 m/s), %", "error @1700, mm"), rows)
    rows = []
    for name, title in _REWARDS.items():
        found = results.get(name, ())
        rows.append([title, str(len(found)), at(found, 600, "returned"), at(found, 1000, "error_mm")])
    titles = ("reward at 4 m/s", "seeds", "returned @600, %", "error @1000, mm")
    return text + "\n" + _whole_ladder(results) + "\n" + table(titles, rows)


_REWARDS = {
    "beta-0.005": "CDTA, beta 0.005",
    "beta-0.01": "CDTA, beta 0.01",
    "reward-4-cdta": "CDTA, beta 0.02 (ours)",
    "beta-0.05": "CDTA, beta 0.05",
    "reward-4-case": "case, weights 0.5 and 0.5",
    "variant-case-accuracy": "case, weights 0 and 1",
    "reward-4-simple": "simple, 1 for a returned ball",
    "variant-simple-accuracy": "simple, returned balls earn their accuracy",
}


def _whole_ladder(results: Results) -> str:
    """The paper's agent from 3 to 9 m/s, at the end of each stage."""
    found = results.get("variant-climb", ())
    speeds = (3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0)
    ends = [[e for result in found if (e := result.last(speed)) is not None] for speed in speeds]
    rows = [
        ["returned, %", *(percent([e.returned for e in known]) for known in ends)],
        ["error, mm", *(millimetres([e.error_mm for e in known]) for known in ends)],
    ]
    title = "The paper's agent on the whole ladder, 600 episodes and then 300 a stage, at the end of each:\n\n"
    return title + table(("", *(f"{speed:g} m/s" for speed in speeds)), rows)


def _landing_model(results: Results) -> str:
    rows = []
    for name, title in _MODELS.items():
        found = results.get(name, ())
        cells = []
        for episode in (50, 100, 200, 300, 1700):
            known = [e for result in found if (e := result.at(episode)) is not None]
            cells.append(
                f"{100 * sum(e.returned for e in known) / len(known):.1f} %, {millimetres([e.error_mm for e in known])}"
                if known
                else ""
            )
        rows.append([title, *cells])
    parts = [
        "## Beyond: the landing-model agent\n",
        table(("returned, error in mm after", "50", "100", "200", "300", "1700"), rows),
        "Ladders, at the end of each stage:\n",
        table(("", "5 m/s", "6", "7", "8", "9"), [_climb(results, name) for name in _CLIMBS]),
    ]
    straight = results.get("model-5", ())
    for name in sorted({name for result in straight for name in result.transfers}):
        moved = [result.transfers[name] for result in straight]
        parts.append(
            f"- trained 1,700 episodes with an exact racket, evaluated with {name}: "
            f"{percent([e.returned for e in moved])} % returned, {millimetres([e.error_mm for e in moved])} mm"
        )
    return "\n".join(parts) + "\n"


_MODELS = {
    "model-5": "5 m/s",
    "model-privileged": "5 m/s, with privileged labels of failed balls",
    "model-predicted": "5 m/s, predicted state",
    "model-flight-5": "5 m/s, gravity known to the model",
    "better-300": "5 m/s, Q critic: 16 updates on batches of 32, 3 relabelled targets, accuracy reward, 30 random",
    "model-impact-5": "5 m/s, law of reflection known to the model",
    "model-hard-9": "9 m/s, hard serves",
    "model-hard-noisy-5": "5 m/s, hard serves, noise 5 mm + 1 %",
    "model-hard-noisy-9": "9 m/s, hard serves, noise 5 mm + 1 %",
    "model-impact-hard-noisy-5": "5 m/s, hard and noisy, law of reflection known",
    "model-impact-hard-noisy-9": "9 m/s, hard and noisy, law of reflection known",
    "model-shaky": "5 m/s, 1 degree of random actuator error",
    "model-biased": "5 m/s, 1 degree of constant actuator bias",
}
_CLIMBS = {
    "model-climb-retain": "100 episodes each, retain",
    "model-climb-discard": "100 episodes each, discard",
    "model-hard-noisy-climb": "hard serves, noise 5 mm + 1 %, 200 each, retain",
}


def _climb(results: Results, name: str) -> list[str]:
    found = results.get(name, ())
    cells = []
    for speed in (5.0, 6.0, 7.0, 8.0, 9.0):
        known = [e for result in found if (e := result.last(speed)) is not None]
        cells.append(millimetres([e.error_mm for e in known]))
    return [_CLIMBS[name], *cells]


def _timings(experiments: Sequence[Experiment], results: Results) -> str:
    rows = []
    for name in ("variant-slow", "replay-threshold", "model-privileged", "model-5"):
        found = results.get(name, ())
        config = next((e.config for e in experiments if e.name == name), None)
        if found and config is not None:
            rows.append([name, str(config.episodes), f"{sum(r.cpu_s for r in found) / len(found):.1f}"])
    titles = ("training", "episodes", "processor seconds, evaluations and files included")
    return "## Time\n\n" + table(titles, rows)


def _charts(results: Results) -> dict[str, str]:
    def lines(named: Mapping[str, str], what: str) -> list[Line]:
        return [curve(title, results[name], what) for name, title in named.items() if results.get(name)]

    rewards = {f"reward-4-{kind}": kind for kind in ("simple", "case", "cdta")}
    slow = {f"reward-slow-3-{kind}": kind for kind in ("simple", "case", "cdta")}
    rules = {f"replay-{rule}": rule for rule in (*RULES, "scratch")}
    rivals = {"replay-threshold": "paper's agent", "model-5": "landing model"} | {
        f"rival-5-matched-{agent}": agent.upper() for agent in RIVALS
    }
    wanted = {
        "rewards-4-error": ("Three rewards at 4 m/s", "error, mm", rewards, "error_mm", 800.0),
        "rewards-3-returned": ("Three rewards at 3 m/s, the paper's pace", "returned, %", slow, "returned", 105.0),
        "replay-error": ("Replay rules: 3 then 5 m/s", "error, mm", rules, "error_mm", 800.0),
        "replay-returned": ("Replay rules: 3 then 5 m/s", "returned, %", rules, "returned", 105.0),
        "rivals-5-error": ("5 m/s, matched exploration", "error, mm", rivals, "error_mm", 800.0),
    }
    return {
        name: line_chart(title, "episode", y_title, lines(named, what), y_top=top)
        for name, (title, y_title, named, what, top) in wanted.items()
    }
