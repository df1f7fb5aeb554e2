"""The report's tables of what goes beyond the paper: the landing-model agent, the whole chain, and the time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from core.bench.learning.plan import Experiment
from core.bench.learning.runs import Results, SeedResult, values_at
from core.bench.learning.tables import Column, at_end, shown, table_of_trainings
from core.text.markdown_table import markdown_table

MODEL_NOTE = """Labels of failed balls that a real robot could not see are masked, except where `privileged` is said.
`gravity known`: the critic predicts the velocity after the stroke, and the parabola is given. `law of reflection
known`: it predicts restitution and grip of the rubber and a small push, and reflection and parabola are given; the form
of physics is told, its numbers are learned.
"""
CHAIN_NOTE = """Nothing of the truth reaches the player here: a ball is served in the simulated world, two event cameras
(1280x720) see it, and the chain of detection, stereo and prediction gives the state on which the stroke is decided,
40 to 50 ms before the ball arrives; the racket has limited speed and acceleration and goes where the ball is expected.
What came of each training ball is told by the simulator. Every evaluated ball is played in that world to its end. Made
by

```
rallyscope train --agent landing-model --state-source events --episodes 150 --seeds 2 --out runs/chain
rallyscope evaluate runs/chain --balls 50 --json > rallyscope-data/bench-learning/events.json
```
"""
FORMATS: Final = ("g", "d", "d", "d", ".1f", "", ".0f", ".0f")
TIMED: Final = (
    ("paper's agent, two updates per episode", "variant-slow", 15),
    ("paper's agent, our four updates", "replay-threshold", None),
    ("landing model, 100 episodes", "model-privileged", 15),
    ("landing model, 1,700 episodes", "model-5", 60),
)
"""What is timed, its training, and the seconds aimed at."""


_MODELS: Final = {
    "5 m/s": "model-5",
    "5 m/s, with privileged labels of failed balls": "model-privileged",
    "5 m/s, predicted state": "model-predicted",
    "5 m/s, gravity known to the model": "model-flight-5",
    "5 m/s, Q critic: 16 updates on batches of 32, 3 relabelled targets, accuracy reward, 30 random": "better-300",
    "5 m/s, law of reflection known to the model": "model-impact-5",
    "9 m/s, hard serves": "model-hard-9",
    "5 m/s, hard serves, noise 5 mm + 1 %": "model-hard-noisy-5",
    "9 m/s, hard serves, noise 5 mm + 1 %": "model-hard-noisy-9",
    "5 m/s, hard and noisy, law of reflection known": "model-impact-hard-noisy-5",
    "9 m/s, hard and noisy, law of reflection known": "model-impact-hard-noisy-9",
    "5 m/s, 1 degree of random actuator error": "model-shaky",
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
        table_of_trainings(results, "returned, error in mm after", _MODELS, columns),
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


def event_cameras(rows: Sequence[Mapping[str, object]]) -> str:
    """The task with the whole chain in the loop; empty if it was not run."""
    if not rows:
        return ""
    cells = []
    for row in rows:
        error, of_seeds, returned = row["error_mm"], row["seeds_error_mm"], row["returned"]
        assert isinstance(error, dict) and isinstance(of_seeds, dict) and isinstance(returned, float)
        mean = f"{error['mean']:.0f}" + ("" if of_seeds["std"] is None else f" ± {of_seeds['std']:.0f}")
        kept = [row[name] for name in ("speed_mps", "seeds", "episodes", "balls")]
        cells.append([*kept, 100 * returned, mean, error["median"], error["p95"]])
    titles = ("m/s", "seeds", "training balls", "evaluation balls", "returned, % (aimed at: 90)")
    titles += ("error, mm (± over seeds)", "median", "95 %")
    return "## With event cameras in the loop\n\n" + CHAIN_NOTE + "\n" + markdown_table(titles, cells, FORMATS)


def timings(experiments: Sequence[Experiment], results: Results) -> str:
    """Processor time of a seed."""
    rows = []
    for title, name, aimed_s in TIMED:
        found = results[name]
        config = next((e.config for e in experiments if e.name == name), None)
        if found and config is not None:
            spent_s = sum(r.cpu_s for r in found) / len(found)
            rows.append([title, config.episodes, spent_s, None if aimed_s is None else f"<= {aimed_s}"])
    titles = ("training", "episodes", "seconds on one core, evaluations and files included", "aimed at")
    return "## Time\n\n" + markdown_table(titles, rows, ("", "d", ".1f"))
