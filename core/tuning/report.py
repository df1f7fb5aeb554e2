"""The result of a search as plain values, for JSON and for the app."""

from __future__ import annotations

from dataclasses import asdict

from core.tuning.tune import TuningResult, TuningTrial


def report_of(result: TuningResult) -> dict[str, object]:
    """Report of a search: start and best config on both sides of the split, and the history.

    `changed` has [before, after] by name; `history` has the objective of each trial on [the tuned, the held-out] side.
    """
    return {
        "start": _sides(result.trials[0]),
        "best": _sides(result.trials[result.best_trial]),
        "best_trial": result.best_trial,
        "better_held_out": result.better_held_out,
        "stopped": result.stopped,
        "trials": len(result.trials),
        "impossible": sum(not trial.possible for trial in result.trials),
        "parameters": list(result.trials[0].values),
        "changed": {name: list(pair) for name, pair in result.changed.items()},
        "importance": dict(result.importance),
        "history": [[trial.tuned.objective, trial.held_out.objective] for trial in result.trials],
    }


def _sides(trial: TuningTrial) -> dict[str, object]:
    return {"tuned": asdict(trial.tuned), "held_out": asdict(trial.held_out)}
