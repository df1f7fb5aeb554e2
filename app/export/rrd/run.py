"""A training run as a Rerun file: where each ball came down, coloured by its case, and the curves, over episodes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from app.export.rrd.blueprint import COLOURS, run_blueprint
from app.export.rrd.paths import EPISODE, PLOTS, WORLD, one_a_row, rerun_file, send
from app.export.rrd.rally import log_arena
from app.export.task import RunTask
from app.export.unfinished import check_cancelled
from app.scene.prediction import CASE_NAMES, CASE_RGB
from core.errors import CommandError
from core.learning.runs.run_files import read_lines, read_run, seed_files
from core.physics.episode import Case

Array = NDArray[np.float64]
Lines = Sequence[dict[str, object]]
SMOOTHED_OVER: Final = 100
ABOVE_M: Final = 0.018
"""Height of landing points: they are drawn as spheres; lower, half of each would be in the table."""
SPOT_M: Final = 0.02
GOAL_M: Final = 0.03
GOAL_RGB: Final = (255, 90, 10)
RETURN_RATE, ERROR, REWARD, EXPLORATION = (f"{PLOTS}/{name}" for name in ("returned", "error", "reward", "noise"))
CURVES: Final = {
    RETURN_RATE: f"Returned, share of the last {SMOOTHED_OVER}; dots: the fixed balls",
    ERROR: f"Landing error, mm, mean of the last {SMOOTHED_OVER}; dots: the fixed balls",
    REWARD: f"Reward, mean of the last {SMOOTHED_OVER}",
    EXPLORATION: "Exploration noise",
}


def export_run(task: RunTask) -> tuple[Path, ...]:
    """Write the file; the run may still be going on, then it is what was played until now.

    Raises:
        ConfigError: if the folder holds no run.
        CommandError: if nothing was played yet.
    """
    run = task.run
    config = read_run(run)
    found = (folder.name.removeprefix("seed-") for folder in run.glob("seed-*"))
    played = {}
    # As numbers: seed 10 stands after seed 9.
    for seed in sorted(int(name) for name in found if name.isdecimal()):
        files = seed_files(run, seed)
        lines = read_lines(files.metrics)[0]
        if lines:
            played[f"seed_{seed}"] = (lines, read_lines(files.evaluations)[0])
    if not played:
        raise CommandError("nothing was played yet", where=run, remedy="train it first")
    blueprint = run_blueprint(list(played), CURVES)
    name = f"{run.resolve().name}-{config.agent}"
    with rerun_file(
        task.path, blueprint, recording_id=name, overwrite=task.order.overwrite, cancelled=task.cancelled
    ) as stream:
        log_arena(stream, None)
        for number, (seed, (lines, evaluations)) in enumerate(played.items()):
            check_cancelled(task.cancelled)
            _send_spots(stream, seed, lines)
            _send_curves(stream, seed, lines, COLOURS[number % len(COLOURS)])
            _send_evaluations(stream, seed, evaluations, COLOURS[number % len(COLOURS)])
            task.progress((number + 1) / (len(played) + 1))
    task.progress(1.0)
    return (task.path,)


def moving_mean(values: Array, over: int) -> Array:
    """(N,) mean of the known values among the last `over`, up to each; nan where there is none."""
    known = np.isfinite(values)
    sums = np.concatenate([[0.0], np.cumsum(np.where(known, values, 0.0))])
    counts = np.concatenate([[0], np.cumsum(known)])
    ends = np.arange(1, len(values) + 1)
    starts = np.maximum(ends - over, 0)
    total, count = sums[ends] - sums[starts], counts[ends] - counts[starts]
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _send_spots(stream: rr.RecordingStream, seed: str, lines: Lines) -> None:
    episodes = _column(lines, "episode").astype(np.int64)
    cases = [Case(int(case)) for case in _column(lines, "case")]
    landings = _points(lines, "landing_m")
    known = np.isfinite(landings).all(axis=1)
    at = np.flatnonzero(known).tolist()
    times = rr.TimeColumn(EPISODE, sequence=episodes)
    if at:
        spots = rr.Points3D.columns(
            positions=np.column_stack([landings[known], np.full(len(at), ABOVE_M)]).astype(np.float32),
            colors=[CASE_RGB[cases[k]] for k in at],
            radii=[SPOT_M] * len(at),
            labels=[CASE_NAMES[cases[k]] for k in at],
            show_labels=[False] * len(at),
        )
        send(stream, f"{WORLD}/{seed}/landing", times, spots.partition(known.astype(np.int32)))
    goals = np.column_stack([_points(lines, "goal_m"), np.full(len(lines), ABOVE_M)]).astype(np.float32)
    target = rr.Points3D.columns(positions=goals, colors=[GOAL_RGB] * len(goals), radii=[GOAL_M] * len(goals))
    send(stream, f"{WORLD}/{seed}/target", times, one_a_row(target, len(goals)))


def _send_curves(stream: rr.RecordingStream, seed: str, lines: Lines, colour: tuple[int, int, int]) -> None:
    episodes = _column(lines, "episode").astype(np.int64)
    returned = (_column(lines, "case") == Case.RETURNED).astype(np.float64)
    curves = {
        RETURN_RATE: moving_mean(returned, SMOOTHED_OVER),
        ERROR: moving_mean(_column(lines, "error_mm"), SMOOTHED_OVER),
        REWARD: moving_mean(_column(lines, "reward"), SMOOTHED_OVER),
        EXPLORATION: _column(lines, "noise"),
    }
    for plot, values in curves.items():
        style = rr.SeriesLines(colors=[colour], names=[seed.replace("_", " ")], widths=[1.5])
        stream.log(f"{plot}/{seed}", style, static=True)
        _send_curve(stream, f"{plot}/{seed}", episodes, values)


def _send_evaluations(stream: rr.RecordingStream, seed: str, lines: Lines, colour: tuple[int, int, int]) -> None:
    for speed in sorted(set(_column(lines, "speed_mps").tolist())):
        rows = [line for line in lines if line["speed_mps"] == speed]
        episodes = _column(rows, "episode").astype(np.int64)
        for plot, key in ((RETURN_RATE, "returned"), (ERROR, "error_mm")):
            entity = f"{plot}/{seed}_fixed_{speed:g}_mps"
            name = f"{seed.replace('_', ' ')}, fixed balls, {speed:g} m/s"
            stream.log(entity, rr.SeriesPoints(colors=[colour], names=[name], marker_sizes=[2.5]), static=True)
            _send_curve(stream, entity, episodes, _column(rows, key))


def _send_curve(stream: rr.RecordingStream, entity: str, episodes: NDArray[np.int64], values: Array) -> None:
    known = np.isfinite(values)
    if known.any():
        scalars = rr.Scalars.columns(scalars=values[known])
        send(stream, entity, rr.TimeColumn(EPISODE, sequence=episodes[known]), scalars)


def _column(lines: Lines, key: str) -> Array:
    """Values of a column; nan where a line has none."""
    return np.array([np.nan if line.get(key) is None else float(str(line[key])) for line in lines])


def _points(lines: Lines, key: str) -> Array:
    rows = [line[key] if isinstance(line.get(key), list) else (None, None) for line in lines]
    return np.array(rows, np.float64).reshape(-1, 2)
