"""The report's tables of what goes beyond the paper: the landing-model agent, the whole chain, and the time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from core.bench.learning.plan import Experiment
from core.bench.learning.runs import SeedResult
from core.bench.learning.tables import millimetres, percent, table

Results = Mapping[str, Sequence[SeedResult]]

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
TIMED = (
    ("paper's agent, two updates per episode", "variant-slow", 15),
    ("paper's agent, our four updates", "replay-threshold", None),
    ("landing model, 100 episodes", "model-privileged", 15),
    ("landing model, 1,700 episodes", "model-5", 60),
)
"""What is timed, its training, and the seconds aimed at."""


def landing_model(results: Results) -> str:
    """The agent whose critic predicts the landing."""
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
        rows.append([title, str(len(found)), *cells])
    parts = [
        "## Beyond: the landing-model agent\n",
        table(("returned, error in mm after", "seeds", "50 episodes", "100", "200", "300", "1700"), rows),
        MODEL_NOTE,
        "Ladders, at the end of each stage:\n",
        table(("", "seeds", "5 m/s", "6", "7", "8", "9"), [_climb(results, name) for name in _CLIMBS]),
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
    return [_CLIMBS[name], str(len(found)), *cells]


def event_cameras(rows: Sequence[Mapping[str, object]]) -> str:
    """The task with the whole chain in the loop; empty if it was not run."""
    if not rows:
        return ""
    cells = []
    for row in rows:
        error, of_seeds, returned = row["error_mm"], row["seeds_error_mm"], row["returned"]
        assert isinstance(error, dict) and isinstance(of_seeds, dict) and isinstance(returned, float)
        spread = of_seeds["std"]
        shown = f"{error['mean']:.0f}" + ("" if spread is None else f" ± {spread:.0f}")
        figures = [f"{error['median']:.0f}", f"{error['p95']:.0f}"]
        kept = [f"{row['speed_mps']:g}", str(row["seeds"]), str(row["episodes"]), str(row["balls"])]
        cells.append([*kept, f"{100 * returned:.1f}", shown, *figures])
    titles = ("m/s", "seeds", "training balls", "evaluation balls", "returned, % (aimed at: 90)")
    titles += ("error, mm (± over seeds)", "median", "95 %")
    return "## With event cameras in the loop\n\n" + CHAIN_NOTE + "\n" + table(titles, cells)


def timings(experiments: Sequence[Experiment], results: Results) -> str:
    """Processor time of a seed."""
    rows = []
    for title, name, aimed_s in TIMED:
        found = results.get(name, ())
        config = next((e.config for e in experiments if e.name == name), None)
        if found and config is not None:
            spent = f"{sum(r.cpu_s for r in found) / len(found):.1f}"
            rows.append([title, str(config.episodes), spent, "-" if aimed_s is None else f"<= {aimed_s}"])
    titles = ("training", "episodes", "seconds on one core, evaluations and files included", "aimed at")
    return "## Time\n\n" + table(titles, rows)
