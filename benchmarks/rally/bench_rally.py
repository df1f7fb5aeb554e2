"""The rally through perception: how exactly the ball is seen, how many balls come back, how long a step takes.

Balls of one speed follow one another in a simulated world with two cameras of the `side` placement and the racket in
their picture; the built-in controller plays. Chains: `filter` is the live rally's; `fit` has its detector, and gravity
through twelve points; `paper` has nothing that the paper has not; on request `auto`, the filter with the detector
`auto`; `points`, the filter with noisy points instead of cameras; and `known`: no cameras, the controller is told at
the launch exactly what will arrive. The world goes on in blocks of 10 ms and waits for the chain: that block is the
delay of perception, and how busy the machine is changes no outcome. Seeds are fixed.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine, machine_words, report_rows_to, two_digits
from benchmarks.rally.closed_loop import ClosedLoop, PlayedBall
from benchmarks.rally.hit_point import (
    HIT_POINT,
    LEAD_TITLES,
    hit_cells,
    hit_point,
    hit_point_rows,
    newest_hit_errors_mm,
)
from core.cameras import stereo_preset
from core.cameras.presets import SENSOR_720
from core.chain.config import ChainConfig, HitRule, published_chain
from core.chain.control.controller import BuiltInController
from core.chain.control.hit_choice import BELOW, HitChoiceConfig
from core.chain.control.player import PlayerState
from core.chain.follow import true_positions
from core.events import SensorSize
from core.files import replace_file
from core.live.worlds.simulated_returns import ReturnOutcome, SimulatedReturnsConfig, play_recorded_states
from core.live.worlds.world import Block, WorldConfig
from core.metrics.score import binomial_interval
from core.physics.config import Profile
from core.physics.episode import Case
from core.physics.flight import air_from_config
from core.physics.task import STAGE_SPEEDS_MPS, TaskConfig, task_profile
from core.recordings import BallTruth
from core.simulation.episodes import draw_serves
from core.text import markdown_table

CHAIN_NAMES: Final = {
    "filter": "the live rally's: detector `refined`, every point counts",
    "fit": "the same detector, gravity through twelve points 4 ms apart, friction at the table",
    "paper": "the paper's detector; five points 10 ms apart, one factor at the table, five new ones after the bounce",
    "auto": "the live rally's filter, with what the detector `auto` sees",
    "points": "the live rally's filter; no cameras: the ball's true place with 0.8 mm of noise along each axis, 500 Hz",
    "known": "no cameras: told at the launch exactly what will arrive",
}
ABOUT: Final = """Two 1280x720 cameras of the `side` placement, noise 0.1 events/s/pixel, physics `{physics}`, serves
without spin, built-in controller aimed at (0.8, 0) m, racket in the picture, windows of 2 ms. Chain and
controller {knowledge}. The world waits for the
chain, so the load of the machine changes no outcome; the delay is a block of 10 ms. Landing: from where a returned ball
lands to the goal. Intervals are Wilson's. A step is wall time of chain and controller beside whatever else ran."""
TITLES: Final = (
    "serve m/s", "balls", "returned % (95 %)", "net/out/own half/missed", "landing mm, median (p95)",
    "3D error mm, median (p95)", "step ms p50 / p99",
)  # fmt: skip


def write_rally_report(
    rows: Sequence[Mapping[str, object]],
    machine: Mapping[str, object],
    seed: int,
    physics: str,
    hit_points: Sequence[Mapping[str, object]] = (),
    *,
    unknown: bool,
) -> str:
    """The page as Markdown."""
    knowledge = "learn air and table from ball to ball" if unknown else "are `told` the physics exactly"
    parts = [
        "# Balls returned through perception",
        f"Made by `rallyscope bench rally --report docs/measured/rally-report.md` (seed {seed};"
        f" {machine_words(machine)}).",
        ABOUT.format(physics=physics, knowledge=knowledge),
    ]
    for chain, words in CHAIN_NAMES.items():
        mine = [row for row in rows if row["chain"] == chain]
        if mine:
            table = markdown_table(TITLES, [_cells(row) for row in mine]).rstrip()
            parts += [f"## `{chain}`", f"{words[0].upper()}{words[1:]}.", table]
            leads = [one for one in hit_points if one["chain"] == chain]
            if leads:
                parts += [HIT_POINT, markdown_table(("serve m/s", *LEAD_TITLES), hit_cells(leads)).rstrip()]
    return "\n\n".join(parts) + "\n"


def _cells(row: Mapping[str, object]) -> list[str]:
    share, balls = float(str(row["returned"])), int(str(row["balls"]))
    low, high = binomial_interval(share, balls)
    return [
        f"{row['speed_mps']:g}",
        str(balls),
        f"{100 * share:.0f} ({100 * low:.0f}-{100 * high:.0f})",
        "/".join(str(row[case]) for case in ("net", "out", "own_half", "missed")),
        _pair(row, "landing_mm"),
        _pair(row, "point_mm"),
        "-" if row["step_ms_p50"] is None else f"{row['step_ms_p50']:.2f} / {row['step_ms_p99']:.2f}",
    ]


def _pair(row: Mapping[str, object], name: str) -> str:
    median, high = row[f"{name}_median"], row[f"{name}_p95"]
    return "-" if median is None else f"{two_digits(median)} ({two_digits(high)})"


def measure_known_balls(
    task: TaskConfig, speed_mps: float, balls: int, seed: int, hit: HitRule = "paper"
) -> dict[str, object]:
    """A row of the rally's bench for `balls` drawn serves; a ball without a stroke that could return it is missed."""
    serves = draw_serves(speed_mps, balls, task, np.random.default_rng([seed, round(1000 * speed_mps)]))
    found = play_recorded_states(serves, SimulatedReturnsConfig(task=task, hit=hit))
    errors_mm = 1e3 * found.error_m[np.isfinite(found.error_m)]
    median, high = np.percentile(errors_mm, (50, 95)).tolist() if len(errors_mm) else (None, None)
    counts = {
        "own_half": found.count(ReturnOutcome.OWN_HALF),
        "net": found.count(ReturnOutcome.NET),
        "out": found.count(ReturnOutcome.LONG) + found.count(ReturnOutcome.WIDE),
    }
    returned = found.count(ReturnOutcome.RETURNED)
    return {
        "sensor": None,
        "speed_mps": speed_mps,
        "balls": balls,
        "seen": None,
        "returned": returned / balls,
        "landing_mm_median": median,
        "landing_mm_p95": high,
        "aim_mm_median": None,
        **counts,
        "missed": balls - returned - sum(counts.values()),
        "points": None,
        "point_mm_median": None,
        "point_mm_p95": None,
        "step_ms_p50": None,
        "step_ms_p99": None,
        "chain_cores": None,
        "wall_s_per_ball": None,
        "lost": None,
    }


Array = NDArray[np.float64]

ChainName = Literal["filter", "fit", "paper", "auto", "points", "known"]
CHAINS: Final[tuple[ChainName, ...]] = ("filter", "fit", "paper")
"""Measured if none is named."""
BALLS: Final = 20
"""Per chain and speed."""
SEED: Final = 2026
FEWEST_POINTS: Final = 5
"""A ball counts as seen from so many points in space on: what a prediction needs."""
WINDOW_US: Final = 2000
POINT_SIGMA_M: Final = 0.0008
"""Of the chain `points`: worse than two cameras of 1280x720, whose points are 0.4 mm off (median; p95 1.1 mm)."""
WRONG_M: Final = 0.02
"""A ball farther than its radius from where it was expected was predicted wrong."""
LATENCY_TURNS: Final = 3
LATENCY_TURN_S: Final = 12.0
"""Of each setting with `latency`, each time."""


@dataclass(slots=True)
class Watched:
    """What was seen of one ball."""

    t_us: list[int] = field(default_factory=list)
    ps_world_m: list[Array] = field(default_factory=list)
    truth: list[BallTruth] = field(default_factory=list)
    step_s: list[float] = field(default_factory=list)
    told: list[tuple[int, Array]] = field(default_factory=list)
    """When each hit point was known, at the end of its block, and the point (3,)."""

    def on_progress(self, block: Block, states: list[PlayerState]) -> None:
        """A block and its steps."""
        self.truth.append(block.ball)
        self.told += [(block.end_us, place) for state in states if (place := hit_point(state)) is not None]
        for state in states:
            self.step_s.append(state.chain.seconds.total + state.control_s)
            if state.chain.point is not None:
                self.t_us.append(state.chain.point.t_us)
                self.ps_world_m.append(state.chain.point.p_world_m)

    def errors_m(self) -> Array:
        """(N,) distance of every point from the truth; points without a true ball are left out."""
        if not self.t_us:
            return np.empty(0)
        errors = np.linalg.norm(np.array(self.ps_world_m) - true_positions(self.whole_truth(), self.t_us), axis=1)
        return errors[np.isfinite(errors)]

    def whole_truth(self) -> BallTruth:
        """The true ball of all blocks."""
        names = ("t_us", "p_world_m", "v_world_mps", "spin_radps", "visible")
        return BallTruth(*(np.concatenate([getattr(part, name) for part in self.truth]) for name in names))


def chain_named(name: Literal["filter", "fit", "paper", "auto", "points"]) -> ChainConfig:
    """`filter`, `points`: the live rally's; `fit`: its detector, gravity through twelve points; `paper`: as published;
    `auto`: the filter with what the detector `auto` sees.
    """
    match name:
        case "auto":
            return ChainConfig.of_method("auto")
        case "filter" | "points":
            return ChainConfig()
        case "fit":
            return ChainConfig(prediction="fit")
        case "paper":
            return published_chain()


def run(
    progress: Callable[[float], None],
    *,
    chain: ChainName | None = None,
    balls: int = BALLS,
    speeds: tuple[float, ...] = STAGE_SPEEDS_MPS,
    physics: Profile = "paper",
    hit: HitRule = "paper",
    unknown: bool = False,
    elevation_spread: float = 0.0,
    seed: int = SEED,
    report: Path | None = None,
    latency: bool = False,
) -> dict[str, object]:
    """A row per chain and speed, and the machine; by default three chains.

    Args:
        progress: gets the share that is done, and rows.
        chain: one chain; None: three.
        balls: of each chain and speed.
        speeds: of the serves, m/s.
        physics: of the balls.
        hit: where balls are met.
        unknown: whether chain and controller learn the constants of air and table; `known` knows the ball anyway.
        elevation_spread: half the range of the serves' elevation about the standard one, degrees.
        seed: of the serves.
        report: a page for the rows.
        latency: adds where the time of the live rally's commands goes.
    """
    chains: tuple[ChainName, ...] = CHAINS if chain is None else (chain,)
    cases: list[tuple[ChainName, float]] = [(name, speed) for name in chains for speed in speeds]
    rows: list[dict[str, object]] = []
    hit_points: list[dict[str, object]] = []
    for name, speed in cases:
        task = task_profile(physics)
        task = replace(task, serve=replace(task.serve, elevation_spread_deg=elevation_spread))
        if name == "known":
            row = measure_known_balls(task, speed, balls, seed, hit)
        else:
            row = measure_rally(
                SENSOR_720,
                speed,
                balls,
                seed=seed,
                chain=chain_named(name),
                world=WorldConfig(task=task),
                hit=hit,
                unknown=unknown,
                point_sigma_m=POINT_SIGMA_M if name == "points" else None,
            )
        points = row.pop("hit_point", [])
        assert isinstance(points, list)
        hit_points += [{"chain": name, "speed_mps": speed} | one for one in points]
        rows.append({"chain": name} | row)
        report_rows_to(progress, rows[-1:], len(rows) / len(cases))
    clock = "wall time per step of chain and controller; `chain_cores` is time of steps per simulated time"
    machine = describe_machine("numba", "numpy", "mujoco", clock=clock)
    if report is not None:
        page = write_rally_report(rows, machine, seed, physics, hit_points, unknown=unknown)
        replace_file(report, page.encode(), durable=False)
    found: dict[str, object] = {"rows": rows, "machine": machine, "hit_point": hit_points}
    if latency:
        from benchmarks.rally.latency import measure_latency  # late: the app and a browser

        found["latency"] = measure_latency(LATENCY_TURNS, LATENCY_TURN_S)
    return found


def measure_rally(
    sensor: SensorSize,
    speed_mps: float,
    balls: int,
    *,
    seed: int = SEED,
    chain: ChainConfig | None = None,
    world: WorldConfig | None = None,
    hit: HitRule = "paper",
    unknown: bool = False,
    point_sigma_m: float | None = None,
) -> dict[str, object]:
    """One row; `chain` may have settings of its own, such as another prediction. Both are told the world's physics
    unless it is `unknown`. With `point_sigma_m` no camera looks, see `ClosedLoop`.
    """
    world = world or WorldConfig()
    loop = ClosedLoop(
        world,
        stereo_preset(sensor=sensor),
        seed=seed,
        chain=chain,
        window_us=WINDOW_US,
        knows_physics=not unknown,
        hit=hit,
        point_sigma_m=point_sigma_m,
    )
    watched, played = [], []
    air = air_from_config(world.task.physics)
    began_s = time.perf_counter()
    try:
        for _ in range(balls):
            watch = Watched()
            played.append(loop.play(speed_mps, watch.on_progress))
            watched.append(watch)
    finally:
        loop.close()
    return {
        "sensor": str(sensor),
        "speed_mps": speed_mps,
        "balls": balls,
        "seen": float(np.mean([len(one.t_us) >= FEWEST_POINTS for one in watched])),
        **_returns(played, BuiltInController(world.task).goal_m),
        **_errors(watched),
        **_times(watched),
        "hit_point": hit_point_rows([newest_hit_errors_mm(one.told, one.whole_truth(), air) for one in watched]),
        "wall_s_per_ball": (time.perf_counter() - began_s) / balls,
        "lost": dict(Counter(cause_of_loss(ball) for ball in played if not ball.returned)),
    }


def cause_of_loss(ball: PlayedBall) -> str:
    """Why a ball did not come back, in words: no stroke could, it was predicted wrong, or what the stroke did."""
    if ball.choice is not None and ball.choice.chosen is None:
        return f"no stroke: {ball.choice.why_not}"
    if not ball.decisions:
        return "no command"
    if ball.aim_error_m > WRONG_M:
        return "predicted wrong"
    x, _, z = ball.decisions[-1].state[:3]
    if z < HitChoiceConfig().lowest_m:
        return f"hit {BELOW}"
    return f"{ball.judged.outcome.case.name.lower().replace('_', ' ')}, hit at x = {x:.2f} m, z = {z:.2f} m"


def _returns(played: list[PlayedBall], goal_m: Array) -> dict[str, object]:
    cases = Counter(ball.judged.outcome.case for ball in played)
    misses = [float(np.linalg.norm(ball.judged.outcome.landing_m[:2] - goal_m)) for ball in played if ball.returned]
    aims = [ball.aim_error_m for ball in played if math.isfinite(ball.aim_error_m)]
    return {
        "returned": cases[Case.RETURNED] / len(played),
        "landing_mm_median": _millimetres(misses, 50),
        "landing_mm_p95": _millimetres(misses, 95),
        "aim_mm_median": _millimetres(aims, 50),
        **{case.name.lower(): cases[case] for case in (Case.OWN_HALF, Case.NET, Case.OUT, Case.MISSED)},
    }


def _errors(watched: list[Watched]) -> dict[str, object]:
    errors = np.concatenate([one.errors_m() for one in watched])
    return {
        "points": len(errors),
        "point_mm_median": _millimetres(errors, 50),
        "point_mm_p95": _millimetres(errors, 95),
    }


def _times(watched: list[Watched]) -> dict[str, object]:
    steps_s = np.concatenate([np.array(one.step_s) for one in watched[1:] or watched])  # the first loads the kernels
    return {
        "step_ms_p50": 1e3 * float(np.percentile(steps_s, 50)),
        "step_ms_p99": 1e3 * float(np.percentile(steps_s, 99)),
        "chain_cores": float(steps_s.mean()) / (WINDOW_US * 1e-6),
    }


def _millimetres(values_m: list[float] | Array, share: float) -> float | None:
    return 1e3 * float(np.percentile(values_m, share)) if len(values_m) else None
