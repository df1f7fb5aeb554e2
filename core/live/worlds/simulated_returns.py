"""Balls whose states are known, played by the simulated robot: what its arm and its strokes can do, perception apart.

The controller is told at the launch, exactly, when, where and with which velocity and spin the ball will cross the
hitting plane, or, where the hit is chosen, each of the places looked at; the racket then goes there within its limits.

Report of the balls of human play that the simulated robot returns, by speed and by spin.
"""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from core.chain.config import HitRule
from core.chain.control.controller import BuiltInController, ControllerConfig, RacketDecision
from core.chain.control.hit_choice import (
    NO_TIME,
    OUT_OF_REACH,
    PAPER_X_M,
    TOO_SLOW,
    FaceTrajectory,
    HitChoiceConfig,
    RacketReach,
    choose_hit,
)
from core.chain.control.known_flight import KnownFlight, fly_to_planes
from core.config import check_settings, setting
from core.errors import ConfigError
from core.extras import require_package
from core.metrics.charts import heat_map
from core.metrics.score import binomial_interval
from core.physics.ball_states import join_serves
from core.physics.contact import HALF_LENGTH_M, HALF_WIDTH_M
from core.physics.episode import Case, Serves
from core.physics.task import TaskConfig
from core.simulation.episodes.ball_outcome import BallOutcome, RallyClassifier
from core.simulation.episodes.incoming import Incoming
from core.simulation.episodes.racket import RacketConfig
from core.text import markdown_table

if TYPE_CHECKING:
    from core.simulation.episodes.mujoco_rally import MujocoRally

Array = NDArray[np.float64]

AS_MEANT_M: Final = 0.05
"""A struck ball that comes down farther from where the stroke should have sent it was not struck as it should."""
LONGEST_S: Final = 6.0
"""From the launch to the verdict; no ball takes so long."""


class ReturnOutcome(IntEnum):
    """Outcome of a ball."""

    RETURNED = 0
    NOT_PLAYABLE = 1
    """The opponent's mistake, or no ball for a robot that waits behind the table: see `Incoming`."""
    NO_STROKE = 2
    """No stroke within the controller's bounds brings it over the net and down."""
    OUT_OF_REACH = 3
    """Farther from the home position than the racket can go."""
    NO_TIME = 4
    """The racket started as soon as the controller knew the ball, but missed it or hit it wrongly."""
    OWN_HALF = 5
    NET = 6
    LONG = 7
    WIDE = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedReturnsConfig:
    """Settings of the simulated returns."""

    task: TaskConfig = field(default_factory=TaskConfig)
    racket: RacketConfig = field(default_factory=RacketConfig)
    controller: ControllerConfig = field(default_factory=ControllerConfig)
    hit: HitRule = "paper"
    """Where balls are met: `chosen` along the flight, or always at the `paper`'s plane."""
    told_after_ms: float = setting(0.0, 0.0, 1000.0)
    """Time after the launch at which the controller gets the ball's state; 0 is ideal."""
    step_ms: float = setting(10.0, 0.5, 20.0)
    """Step of the simulation; the racket's limits act from step to step (choice: with 2 ms, 1,200 balls had the same
    fates)."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedReturns:
    """Outcomes of N balls."""

    fate: NDArray[np.int8]
    """(N,) values of `ReturnOutcome`."""
    incoming: NDArray[np.int8]
    """(N,) values of `Incoming`."""
    is_service: NDArray[np.bool_]
    """(N,) whether it bounces on the opponent's half first."""
    error_m: Array
    """(N,) from the target to where a returned ball landed; NaN for others."""

    def count(self, fate: ReturnOutcome) -> int:
        """Number of balls with this outcome."""
        return int(np.count_nonzero(self.fate == fate))


def play_recorded_states(
    balls: Serves, config: SimulatedReturnsConfig, progress: Callable[[float], None] = lambda share: None
) -> SimulatedReturns:
    """Play each ball alone, from its launch to its outcome."""
    choice = HitChoiceConfig()
    xs_m = choice.xs_m if config.hit == "chosen" else np.array([config.task.stroke.hit_plane_x_m])
    planes = fly_to_planes(balls, xs_m, config.task)
    incoming = np.min([plane.incoming for plane in planes], axis=0)  # PLAYABLE is the smallest: somewhere it is
    if config.hit == "chosen":
        at_plane = planes[int(np.flatnonzero(xs_m == PAPER_X_M)[0])].incoming
        incoming = np.where(incoming == Incoming.PLAYABLE, incoming, at_plane)
    fate = np.full(len(balls), ReturnOutcome.NOT_PLAYABLE, np.int8)
    error_m = np.full(len(balls), np.nan)
    controller = BuiltInController(config.task, config.controller)
    require_package("mujoco", "playing recorded balls")
    from core.simulation.episodes.mujoco_rally import MujocoRally  # late: MuJoCo may not be installed

    rally = MujocoRally(config.task, config.racket, dt_s=1e-3 * config.step_ms)
    judge = RallyClassifier(config.task)
    for i in np.flatnonzero(incoming == Incoming.PLAYABLE):
        flight = KnownFlight.of(planes, int(i))
        hit = flight.hits[0]
        if config.hit == "chosen":
            racket = FaceTrajectory(1e-3 * config.told_after_ms, config.racket.home_m, np.zeros(3))
            reach = RacketReach.of_config(config.racket)
            chosen = choose_hit(flight, controller.strokes(), racket, reach, choice)
            if chosen.chosen is None:
                fate[i] = FATE_OF_REASON.get(chosen.why_not, ReturnOutcome.NO_STROKE)
                continue
            hit = chosen.chosen.hit
        assert hit is not None  # it is playable
        decision = controller.decide(hit.t_s, hit.p_world_m, hit.v_world_mps, stage="post", spin_radps=hit.spin_radps)
        if decision is None:
            fate[i] = ReturnOutcome.NO_STROKE
            continue
        rally.reset()
        serve = rally.serve(balls.ps_m[i], balls.vs_mps[i], balls.spins_radps[i])
        judge.feed([serve])
        if config.told_after_ms:
            judge.feed(rally.step(1e-3 * config.told_after_ms))
        try:
            rally.aim_racket(decision.target)
        except ConfigError:
            fate[i] = ReturnOutcome.OUT_OF_REACH
            continue
        outcome = _watch(rally, judge)
        fate[i] = _fate(outcome, decision)
        if outcome.case is Case.RETURNED:
            error_m[i] = np.linalg.norm(outcome.landing_m[:2] - controller.goal_m)
        progress((i + 1) / len(balls))
    return SimulatedReturns(fate, incoming.astype(np.int8), planes[0].is_service, error_m)


FATE_OF_REASON: Final = {
    OUT_OF_REACH: ReturnOutcome.OUT_OF_REACH,
    NO_TIME: ReturnOutcome.NO_TIME,
    TOO_SLOW: ReturnOutcome.NO_TIME,
}
"""Outcome of a ball for which the choice found no hit; for other reasons there is no stroke."""


def _watch(rally: MujocoRally, judge: RallyClassifier) -> BallOutcome:
    while rally.time_s < LONGEST_S:
        for outcome in judge.feed(rally.step()):
            return outcome
    raise ConfigError("a ball without an outcome", got=f"{LONGEST_S:g} s after its launch", where="play_known_balls")


def _fate(outcome: BallOutcome, decision: RacketDecision) -> ReturnOutcome:
    if outcome.case is Case.RETURNED:
        return ReturnOutcome.RETURNED
    assert decision.landing_m is not None
    as_meant = np.linalg.norm(outcome.landing_m[:2] - decision.landing_m) < AS_MEANT_M
    if not as_meant:  # nothing but a late racket can have done that; a miss has no landing at all
        return ReturnOutcome.NO_TIME
    if outcome.case is Case.OUT:
        beside = abs(float(outcome.landing_m[1])) > HALF_WIDTH_M
        return ReturnOutcome.WIDE if beside and outcome.landing_m[0] <= HALF_LENGTH_M else ReturnOutcome.LONG
    return ReturnOutcome.NET if outcome.case is Case.NET else ReturnOutcome.OWN_HALF


Mask = NDArray[np.bool_]
Row = dict[str, object]

SPEED_EDGES_MPS: Final = (0.0, 4.0, 5.0, 6.0, 7.0, 8.0, np.inf)
SPIN_EDGES_RADPS: Final = (0.0, 25.0, 50.0, 75.0, 100.0, 150.0, np.inf)
INCOMING_WORDS: Final = {
    Incoming.NET: "into the net before the robot",
    Incoming.NO_BOUNCE: "no bounce on the robot's half",
    Incoming.FAR_HALF: "down on the opponent's half",
    Incoming.TWO_BOUNCES: "two bounces before the hitting plane",
    Incoming.SHORT: "off the table's side, not as far as the hitting plane",
}
FATE_WORDS: Final = {
    ReturnOutcome.NO_STROKE: "no stroke within the bounds",
    ReturnOutcome.OUT_OF_REACH: "out of the racket's reach",
    ReturnOutcome.NO_TIME: "racket not there, or not as it should be, in time",
    ReturnOutcome.OWN_HALF: "struck onto the own half",
    ReturnOutcome.NET: "struck into the net",
    ReturnOutcome.LONG: "struck beyond the table",
    ReturnOutcome.WIDE: "struck beside the table",
}


@dataclass(frozen=True, slots=True, eq=False)
class PlayedFile:
    """The balls of one file and their outcomes."""

    name: str
    balls: Serves
    played: SimulatedReturns


def summary_row(name: str, played: SimulatedReturns, which: Mask) -> Row:
    """Counts, and the share of the playable balls that came back, with its 95 % interval."""
    playable = int((which & (played.fate != ReturnOutcome.NOT_PLAYABLE)).sum())
    errors = 1e3 * played.error_m[which & (played.fate == ReturnOutcome.RETURNED)]
    returned = len(errors)
    low, high = binomial_interval(returned / playable, playable) if playable else (None, None)
    median, p95 = np.percentile(errors, (50, 95)).tolist() if returned else (None, None)
    return {
        "balls": name,
        "count": int(which.sum()),
        "playable": playable,
        "returned": returned,
        "share": returned / playable if playable else None,
        "low": low,
        "high": high,
        "error_mm_median": median,
        "error_mm_p95": p95,
    }


def losses(played: SimulatedReturns) -> dict[str, int]:
    """Number of lost balls by cause."""
    found = {words: int((played.incoming == kind).sum()) for kind, words in INCOMING_WORDS.items()}
    found |= {words: played.count(fate) for fate, words in FATE_WORDS.items()}
    return {words: count for words, count in found.items() if count}


def report_rows(files: Sequence[PlayedFile]) -> dict[str, list[Row]]:
    """Rows by file, by speed at the state and by spin there."""
    whole = _joined(files)
    return {
        "files": [_row_of(file) for file in files],
        "speeds": [summary_row(f"{name} m/s", whole.played, which) for name, which in _by_speed(whole.balls)],
        "spins": [summary_row(f"{name} rad/s", whole.played, which) for name, which in _by_spin(whole.balls)],
    }


def write_ball_states_report(
    path: Path, files: Sequence[PlayedFile], config: SimulatedReturnsConfig, command: str
) -> None:
    """The page, and its picture in `images/` beside it."""
    whole, rows = _joined(files), report_rows(files)
    every = _row_of(whole)
    lost = {file.name: losses(file.played) for file in files}
    words = [
        one for one in (*INCOMING_WORDS.values(), *FATE_WORDS.values()) if any(one in each for each in lost.values())
    ]
    parts = [
        "# Balls of human play against the simulated robot\n",
        f"Made by `{command}`.\n",
        *(f"{textwrap.fill(text, 118)}\n" for text in (_about_balls(every, config), _about_robot(config))),
        _table([*rows["files"], every] if len(files) > 1 else rows["files"]),
        "## By speed where the state begins\n",
        _table(rows["speeds"]),
        "## By spin there\n",
        _table(rows["spins"]),
        f"![returned by speed and spin](images/{path.stem}.svg)\n",
        "## What the others were lost to\n",
        markdown_table(("", *lost), [[one, *(each.get(one, 0) for each in lost.values())] for one in words],
                       ("", *[","] * len(lost))),
    ]  # fmt: skip
    path.write_text("\n".join(parts), encoding="utf-8")
    _draw(path.parent / "images" / f"{path.stem}.svg", whole)


def _about_balls(row: Row, config: SimulatedReturnsConfig) -> str:
    when = f"{config.told_after_ms:g} ms after the launch" if config.told_after_ms else "at the launch"
    where = f"the hitting plane, x = {config.task.stroke.hit_plane_x_m:g} m"
    if config.hit == "chosen":
        where = "one of the places along the flight where the hit may be chosen"
    return (
        "The files hold states of balls in human play: position, velocity and spin. Each is launched as it is. "
        f"Of {row['count']:,} balls {row['playable']:,} are playable: they bounce once on the robot's half (a service "
        f"on the other half first) and come to {where}. "
        f"**{row['returned']:,} come back.** The built-in controller plays with perfect knowledge: {when} it is told "
        "exactly when, where, how fast and with which spin the ball will be there. So this is what arm and "
        "strokes can do, without any error of perception."
    )


def _about_robot(config: SimulatedReturnsConfig) -> str:
    air, top = config.task.physics.air, config.task.physics.table
    racket, bounds = config.racket, config.controller
    return (
        f"Physics: drag {air.drag_coefficient:g}, Magnus {air.magnus_coefficient:g}, table {top.restitution:g} and "
        f"{top.friction:g}. Racket: {racket.max_speed_mps:g} m/s, {racket.max_acceleration_mps2:g} m/s², within "
        f"{racket.reach_m:g} m of its place; strokes along x with {bounds.slowest_mps:g} to {bounds.fastest_mps:g} "
        f"m/s, angles within {config.task.stroke.action_limit_deg:g} degrees, target ({bounds.target_x_m:g}, "
        f"{bounds.target_y_m:g}) m. The distance from the target is that of returned balls; where no safe stroke "
        "reaches it, one that lands elsewhere is played."
    )


def _table(rows: Sequence[Row]) -> str:
    def text(row: Row, key: str, form: str, scale: int = 1) -> str:
        value = row[key]
        return format(scale * value, form) if isinstance(value, float) else "-"

    cells = [
        [
            *(row[key] for key in ("balls", "count", "playable", "returned")),
            f"{text(row, 'share', '.1f', 100)} [{text(row, 'low', '.1f', 100)}, {text(row, 'high', '.1f', 100)}]",
            f"{text(row, 'error_mm_median', '.1f')} / {text(row, 'error_mm_p95', '.0f')}",
        ]
        for row in rows
    ]
    titles = (
        "balls",
        "count",
        "playable",
        "returned",
        "of the playable, % [95 %]",
        "off the target, mm, median / 95 %",
    )
    return markdown_table(titles, cells, ("", ",", ",", ","))


def _draw(path: Path, whole: PlayedFile) -> None:
    by_speed, by_spin = _by_speed(whole.balls), _by_spin(whole.balls)
    playable, returned = whole.played.fate != ReturnOutcome.NOT_PLAYABLE, whole.played.fate == ReturnOutcome.RETURNED
    counts, hits = (
        np.array([[(counted & a & b).sum() for _, a in by_speed] for _, b in by_spin])
        for counted in (playable, returned)
    )
    names = [name for name, _ in by_speed], [name for name, _ in by_spin]
    title = "Playable balls of human play that come back"
    heat_map(path, title, "speed, m/s", "spin, rad/s", *names, hits / np.maximum(counts, 1), counts)


def _by_speed(balls: Serves) -> list[tuple[str, Mask]]:
    return _bins(np.linalg.norm(balls.vs_mps, axis=1), SPEED_EDGES_MPS)


def _by_spin(balls: Serves) -> list[tuple[str, Mask]]:
    return _bins(np.linalg.norm(balls.spins_radps, axis=1), SPIN_EDGES_RADPS)


def _bins(values: Array, edges: Sequence[float]) -> list[tuple[str, Mask]]:
    return [
        (f"from {low:g}" if high == np.inf else f"{low:g} to {high:g}", (low <= values) & (values < high))
        for low, high in itertools.pairwise(edges)
    ]


def _row_of(file: PlayedFile) -> Row:
    return summary_row(file.name, file.played, np.ones(len(file.balls), np.bool_))


def _joined(files: Sequence[PlayedFile]) -> PlayedFile:
    names = ("fate", "incoming", "is_service", "error_m")
    played = SimulatedReturns(*(np.concatenate([getattr(file.played, name) for file in files]) for name in names))
    return PlayedFile("all", join_serves([file.balls for file in files]), played)
