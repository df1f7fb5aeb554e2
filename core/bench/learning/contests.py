"""The report's tables of the paper's agent against rivals, and against what the paper leaves open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from core.bench.learning.plan import EXPLORATIONS, RIVALS, rival_training
from core.bench.learning.runs import SeedResult
from core.bench.learning.tables import at, millimetres, percent, table

Results = Mapping[str, Sequence[SeedResult]]

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


def variants(results: Results) -> str:
    """What the paper leaves open, or writes otherwise."""
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
        late = at(found, 1700, "returned"), at(found, 1700, "error_mm")
        rows.append([title, str(len(found)), at(found, 600, "returned"), *late])
    text = "## What the paper leaves open\n\nThe curriculum of 3 then 5 m/s:\n\n"
    text += table(("variant", "seeds", "returned @600 (3 m/s), %", "@1700 (5 m/s), %", "error @1700, mm"), rows)
    rows = []
    for name, title in _REWARDS.items():
        found = results.get(name, ())
        rows.append([title, str(len(found)), at(found, 600, "returned"), at(found, 1000, "error_mm")])
    titles = ("reward at 4 m/s", "seeds", "returned @600, %", "error @1000, mm")
    return text + "\n" + _whole_curriculum(results) + "\n" + table(titles, rows)


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


def _whole_curriculum(results: Results) -> str:
    """The paper's agent from 3 to 9 m/s, at the end of each stage."""
    found = results.get("variant-climb", ())
    speeds = (3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0)
    ends = [[e for result in found if (e := result.last(speed)) is not None] for speed in speeds]
    rows = [
        ["returned, %", *(percent([e.returned for e in known]) for known in ends)],
        ["error, mm", *(millimetres([e.error_mm for e in known]) for known in ends)],
    ]
    title = "The paper's agent on the whole curriculum, 600 episodes and then 300 a stage, at the end of each:\n\n"
    return title + table(("", *(f"{speed:g} m/s" for speed in speeds)), rows)
