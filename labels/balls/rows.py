"""Rows of the ball index: every flight, bounce, stroke and net touch of a recording or a training run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.history.rally_history import FLIGHT_GAP_US
from core.history.recorded_rally import EPISODES, PREDICTIONS
from core.learning.runs.run_files import read_lines, read_run, seed_files
from core.physics.episode import Case
from core.recordings.reader import FileRecording
from core.recordings.truth import LARGEST_GAP_US, BallTruth
from labels.contacts import contacts_of_truth
from labels.model import ContactKind, ContactLabel

Array = NDArray[np.float64]
Rows = Mapping[str, np.ndarray]
NAN: Final = math.nan
UNKNOWN_STATE: Final = (math.nan,) * 9
KIND_OF: Final = {ContactKind.BOUNCE: "bounce", ContactKind.HIT: "stroke", ContactKind.NET: "net"}
KINDS: Final = ("flight", *KIND_OF.values())
TRUTH, PREDICTED, EPISODE, TRACKED = "truth", "prediction", "episode", "tracker"
"""Methods: where the figures of a row are from. Rows of a run name its agent."""
JUMP_M: Final = 0.1
"""A ball this much farther on than twice its speed explains is another ball: a serve that follows at once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BallRow:
    """One event of a ball; NaN, None and "" for what is not known."""

    kind: str
    """One of `KINDS`."""
    number: int
    """Ball of the recording, or episode of the run, from 1."""
    t_us: int | None = None
    """Time on the recording's clock; None for a run, which has none."""
    end_us: int | None = None
    """End of a flight."""
    speed_mps: float = NAN
    """At the start of a flight, before a bounce or a net touch, after a stroke."""
    spin_radps: float = NAN
    """Magnitude, at the same moment; of the tracker that at the hitting plane, by its last estimate."""
    spin_sigma_radps: float = NAN
    """Standard deviation of the magnitude; 0 for a true one."""
    net_z_m: float = NAN
    """Height of the ball's centre above the table at the net, in this flight, or in that which begins or is bounced."""
    error_m: float = NAN
    """Distance of the landing from its goal."""
    outcome: str = ""
    """Name of the ball's `Case`, in small letters."""
    method: str
    state: tuple[float, ...] = UNKNOWN_STATE
    """(9,) position (m), velocity (m/s) and spin (rad/s) in the world, of the moment of `speed_mps`."""


@dataclass(frozen=True, slots=True, eq=False)
class FlownPath:
    """N positions of balls, t_us ascending."""

    t_us: NDArray[np.int64]
    ps_world_m: Array
    """(N, 3)."""
    vs_world_mps: Array
    """(N, 3)."""
    spins_radps: Array
    """(N, 3), world axes."""
    spin_sigmas_radps: Array
    """(N,) of the magnitude of the spin."""
    begins: NDArray[np.bool_]
    """(N,) the first position of a ball."""


def path_of_truth(ball: BallTruth) -> FlownPath:
    """The true path where there is a ball in play."""
    known = ball.visible & np.isfinite(ball.v_world_mps).all(axis=1) & np.isfinite(ball.p_world_m).all(axis=1)
    t_us, ps, vs = ball.t_us[known], ball.p_world_m[known], ball.v_world_mps[known]
    step_us, moved_m = np.diff(t_us), np.linalg.norm(np.diff(ps, axis=0), axis=1)
    begins = np.ones(len(t_us), np.bool_)
    begins[1:] = (step_us > LARGEST_GAP_US) | (moved_m > JUMP_M + 2e-6 * step_us * np.linalg.norm(vs[:-1], axis=1))
    spins = ball.spin_radps[known]
    return FlownPath(t_us, ps, vs, spins, np.where(np.isfinite(spins).all(axis=1), 0.0, np.nan), begins)


def rows_of_path(path: FlownPath, contacts: Sequence[ContactLabel], method: str) -> list[BallRow]:
    """The flights of a path, each to the next stroke or the ball's end, and its contacts, by time."""
    t_us = path.t_us
    if not len(t_us):
        return []
    ball = np.cumsum(path.begins)
    # The jump from one ball to the next is no stroke.
    contacts = [one for one in contacts if not path.begins[_neighbours(t_us, one.t_us)[1]].any()]
    hits_us = np.array([one.t_us for one in contacts if one.kind is ContactKind.HIT], np.int64)
    struck = np.searchsorted(t_us, hits_us, side="right")  # first position after each
    firsts = np.union1d(np.flatnonzero(path.begins), struck[struck < len(t_us)])
    ends = np.append(firsts[1:], len(t_us))
    start_of = dict(zip(struck.tolist(), hits_us.tolist(), strict=True))
    net_z_m = [_net_z_m(path, first, end) for first, end in zip(firsts, ends, strict=True)]

    def row_at(kind: str, at: int, flight: int, start_us: int, end_us: int | None = None) -> BallRow:
        return BallRow(
            kind=kind,
            number=int(ball[at]),
            t_us=start_us,
            end_us=end_us,
            speed_mps=float(np.linalg.norm(path.vs_world_mps[at])),
            spin_radps=float(np.linalg.norm(path.spins_radps[at])),
            spin_sigma_radps=float(path.spin_sigmas_radps[at]),
            net_z_m=net_z_m[flight],
            method=method,
            state=(*path.ps_world_m[at].tolist(), *path.vs_world_mps[at].tolist(), *path.spins_radps[at].tolist()),
        )

    rows = []
    for number, (first, end) in enumerate(zip(firsts.tolist(), ends.tolist(), strict=True)):
        start_us, end_us = start_of.get(first, int(t_us[first])), start_of.get(end, int(t_us[end - 1]))
        rows.append(row_at("flight", first, number, start_us, end_us))
    for contact in contacts:
        before, after = _neighbours(t_us, contact.t_us)
        at = int(after[-1] if contact.kind is ContactKind.HIT else before)
        flight = max(int(np.searchsorted(firsts, at, side="right")) - 1, 0)
        rows.append(row_at(KIND_OF[contact.kind], at, flight, contact.t_us))
    return sorted(rows, key=lambda row: (row.t_us or 0, KINDS.index(row.kind)))


def _neighbours(t_us: NDArray[np.int64], at_us: int) -> tuple[int, NDArray[np.int64]]:
    """The last position before a time, and the first ones not before and after it.

    A position at the very time of a contact may be of either side of it.
    """
    first = np.searchsorted(t_us, [at_us, at_us + 1])
    return max(int(first[0]) - 1, 0), np.minimum(first, len(t_us) - 1)


def _net_z_m(path: FlownPath, first: int, end: int) -> float:
    """Height at which the positions [first, end) first cross x = 0; NaN where they do not."""
    x, z = path.ps_world_m[first:end, 0], path.ps_world_m[first:end, 2]
    crossed = np.flatnonzero(np.sign(x[:-1]) * np.sign(x[1:]) < 0)
    if not len(crossed):
        return NAN
    at = int(crossed[0])
    share = x[at] / (x[at] - x[at + 1])
    return float(z[at] + share * (z[at + 1] - z[at]))


def rows_of_recording(recording: FileRecording) -> list[BallRow]:
    """What a file itself says of its balls: the truth, else the stored predictions, else the stored episodes.

    Empty where it says nothing: then only the tracker can find them, see `tracking.py`.
    """
    ball, episodes, predictions = recording.ball, recording.read_rows(EPISODES), recording.read_rows(PREDICTIONS)
    rows = [] if ball is None else rows_of_path(path_of_truth(ball), contacts_of_truth(ball), TRUTH)
    if not rows and predictions is not None:
        rows = _rows_of_predictions(predictions)
    if not rows and episodes is not None:
        served = zip(episodes["serve_us"].tolist(), episodes["speed_mps"].tolist(), strict=True)
        rows = [
            BallRow(kind="flight", number=number, t_us=t_us, speed_mps=speed, method=EPISODE)
            for number, (t_us, speed) in enumerate(served, start=1)
        ]
    return rows if episodes is None else with_outcomes(rows, episodes)


def with_outcomes(rows: Sequence[BallRow], episodes: Rows) -> list[BallRow]:
    """The rows with the outcome, and the distance from the goal, of the serve that each follows."""
    order = np.argsort(episodes["serve_us"], kind="stable")
    serves_us, cases = episodes["serve_us"][order], episodes["case"][order]
    errors_m = np.linalg.norm(episodes["f"][order, :2] - episodes["g"][order], axis=1)
    found = []
    for row in rows:
        at = -1 if row.t_us is None else int(np.searchsorted(serves_us, row.t_us, side="right")) - 1
        known = at >= 0
        outcome = case_name(cases[at]) if known else ""
        found.append(replace(row, outcome=outcome, error_m=float(errors_m[at])) if known else row)
    return found


def case_name(case: object) -> str:
    """Name of an outcome as the index has it; "" for a value that is none."""
    return Case(int(str(case))).name.lower() if str(case) in {str(int(one)) for one in Case} else ""


def _rows_of_predictions(predictions: Rows) -> list[BallRow]:
    """A flight for each predicted ball: from its first prediction to the expected hit, with the speed there."""
    t_us, hits_us = predictions["t_us"], predictions["t_hit_us"]
    firsts = np.flatnonzero(np.diff(t_us, prepend=t_us[:1] - FLIGHT_GAP_US - 1) > FLIGHT_GAP_US)
    lasts = np.append(firsts[1:], len(t_us)) - 1
    return [
        BallRow(
            kind="flight",
            number=number,
            t_us=int(t_us[first]),
            end_us=int(hits_us[last]),
            speed_mps=float(np.linalg.norm(predictions["v_hit_mps"][last])),
            method=PREDICTED,
        )
        for number, (first, last) in enumerate(zip(firsts.tolist(), lasts.tolist(), strict=True), start=1)
    ]


def rows_of_run(run: Path, seed: int, cancelled: Callable[[], bool] = lambda: False) -> list[BallRow]:
    """A flight, the serve, and a stroke for each episode of a seed of a training run.

    Raises:
        ConfigError: if the folder holds no run, or a line is not what a run writes.
    """
    agent = read_run(run).agent
    lines, _ = read_lines(seed_files(run, seed).metrics)
    rows = []
    for line in lines:
        if cancelled():
            break
        serve = line.get("serve")
        numbers = tuple(map(_number, serve)) if isinstance(serve, list) else ()
        is_known = len(numbers) == len(UNKNOWN_STATE)
        state = numbers if is_known else UNKNOWN_STATE
        serve_speed = math.hypot(*state[3:6]) if is_known else _number(line.get("speed_mps"))
        spin = math.hypot(*state[6:])
        number = int(_number(line.get("episode"))) + 1
        error_m, outcome = 1e-3 * _number(line.get("error_mm")), case_name(line.get("case"))
        flight = BallRow(
            kind="flight", number=number, speed_mps=serve_speed, spin_radps=spin, method=agent, error_m=error_m,
            spin_sigma_radps=0.0 if math.isfinite(spin) else NAN, outcome=outcome, state=state,
        )  # fmt: skip
        net_z_m = _number(line.get("net_z_m"))
        stroke = BallRow(kind="stroke", number=number, net_z_m=net_z_m, error_m=error_m, outcome=outcome, method=agent)
        rows += [flight, stroke]
    return rows


def _number(value: object) -> float:
    return float(value) if isinstance(value, (int, float)) and abs(value) < 1e12 else NAN
