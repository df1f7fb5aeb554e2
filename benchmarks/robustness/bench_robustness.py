"""The table of robustness: balls returned, and where they land, by what is wrong with what is believed of a lab.

A row per cell of `cells`; sessions of ten balls are kept in the folder and not played again.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.machine import describe_machine, machine_words, report_rows_to, two_digits
from benchmarks.rally.closed_loop import ClosedLoop, PlayedBall
from core.cameras import Camera, stereo_preset
from core.chain.config import expected_physics
from core.chain.control.controller import BuiltInController, ControllerConfig
from core.chain.control.player import FREEZE_S, JITTERS
from core.chain.control.step_test import CommandLatency, RacketStep, command_latency
from core.errors import CommandError
from core.events import Events
from core.files import replace_file
from core.geometry import random_direction
from core.jobs.control import TaskControl
from core.jobs.jobs import ALONE, HERE, JobBackend, open_jobs
from core.live.worlds.world import SimulatedWorld, WorldConfig
from core.metrics.score import binomial_interval
from core.physics.config import PhysicsConfig
from core.physics.episode import Case
from core.physics.rotation import base_orientation, multiply_quaternions
from core.physics.task import TaskConfig, task_profile
from core.simulation.episodes.racket import RacketTarget
from core.text import markdown_table, parse_json
from core.trajectory.filter_config import UNKNOWN

Constant = Literal["drag", "restitution", "friction"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One row. Signs, directions, cameras and instants are drawn; the sizes are these."""

    name: str
    """For `--only`."""
    words: str
    told: str = ""
    """What is told exactly of what is otherwise found out; empty: nothing."""
    constant: Constant | None = None
    sigmas: float = 0.0
    """By so many of its standard deviations the constant is not what is expected, up or down."""
    pixels: float = 0.0
    """By which each camera's principal point was calibrated wrong, in a random direction."""
    degrees: float = 0.0
    """By which each camera's orientation was calibrated wrong, about a random axis."""
    clock_ms: float = 0.0
    """By which the stamps of one of the cameras are late."""
    latency_ms: float = 0.0
    """From a command to its effect."""
    jitter_ms: float = 0.0
    """Half the range by which that differs from command to command."""
    led: bool = True
    """Whether the controller leads by what a step test found of the latency."""
    racket_deg: float = 0.0
    """By which the racket stands otherwise than commanded, about a random axis, each ball another."""
    lamp: bool = False
    """A lamp in both pictures flickers a hundred times a second."""
    blocked_ms: float = 0.0
    """For so long one camera sees nothing, once a flight."""


TOLD: Final = Cell(name="told", words="nothing is wrong", told="air, table")
CELLS: Final = (
    TOLD,
    Cell(name="nothing-told", words="nothing is wrong"),
    *(
        Cell(name=f"{constant}-{sigmas}", words=f"{constant} {sigmas} sigma", constant=constant, sigmas=sigmas)
        for constant in ("drag", "restitution", "friction")
        for sigmas in (1, 2)
    ),
    *(Cell(name=f"calibration-{px:g}px", words=f"calibration {px:g} px", pixels=px) for px in (0.2, 0.5, 1.0)),
    Cell(name="calibration-half-degree", words="calibration 0.5 degree", degrees=0.5),
    *(Cell(name=f"clock-{ms:g}ms", words=f"clock of a camera {ms:g} ms", clock_ms=ms) for ms in (0.2, 1.0)),
    Cell(name="latency-10", words="commands 10 ms late, led", latency_ms=10.0),
    Cell(name="latency-40", words="commands 40 ms late, led", latency_ms=40.0),
    Cell(name="latency-40-jitter", words="commands 40 +- 5 ms late, led", latency_ms=40.0, jitter_ms=5.0),
    Cell(name="latency-40-unled", words="commands 40 +- 5 ms late, not led", latency_ms=40.0, jitter_ms=5.0, led=False),
    Cell(name="racket-1-degree", words="racket 1 degree off", racket_deg=1.0),
    Cell(name="flicker", words="a lamp flickers at 100 Hz", lamp=True),
    Cell(name="blocked-20ms", words="a camera blocked for 20 ms", blocked_ms=20.0),
)
"""In the order of the table."""


LAMP_HZ: Final = 100.0
LAMP_RADIUS_PX: Final = 40
SWING_US: Final = 1000
"""Within so much the lamp's pixels answer a rise or a fall."""
EARLIEST_S, LATEST_S = 0.05, 0.35
"""After the serve a camera is blocked some time in between."""


class WrongWires:
    """Errors of one session, drawn as a cell specifies."""

    def __init__(self, cell: Cell, cameras: Mapping[str, Camera], rng: np.random.Generator) -> None:
        self._cell, self._rng = cell, rng
        self._names = sorted(cameras)
        self._late = str(rng.choice(self._names))
        self._held: dict[str, Events] = {}
        self._lamps = {name: self._lamp(camera) for name, camera in cameras.items()} if cell.lamp else {}
        self._blocked, self._blocked_us = "", (0, 0)
        self._tilt = np.array([1.0, 0.0, 0.0, 0.0])

    def begin_ball(self, served_us: int) -> None:
        """Draw what is another with every ball."""
        start_us = served_us + round(1e6 * self._rng.uniform(EARLIEST_S, LATEST_S))
        self._blocked = str(self._rng.choice(self._names))
        self._blocked_us = start_us, start_us + round(1e3 * self._cell.blocked_ms)
        self._tilt = _turn(self._cell.racket_deg, self._rng).as_quat(scalar_first=True)

    def seen(self, events: Mapping[str, Events], start_us: int, end_us: int) -> Mapping[str, Events]:
        """What of a block's events comes through, by camera."""
        found = dict(events)
        for name, lamp in self._lamps.items():
            found[name] = _joined(found[name], self._flicker(lamp, found[name], start_us, end_us))
        low_us, high_us = self._blocked_us
        if self._blocked in found and low_us < end_us and start_us < high_us:
            one = found[self._blocked]
            found[self._blocked] = _joined(one.between(start_us, low_us), one.between(high_us, end_us))
        if self._cell.clock_ms and self._late in found:
            late = _later(found[self._late], round(1e3 * self._cell.clock_ms))
            held = self._held.get(self._late)
            whole = late if held is None else _joined(held, late)
            self._held[self._late] = whole.between(end_us, 1 << 62)
            found[self._late] = whole.between(start_us, end_us)
        return found

    def command(self, world: SimulatedWorld, target: RacketTarget) -> None:
        """Give the racket a target: tilted, and so much later as commands take.

        Raises:
            ConfigError: if it is out of bounds.
        """
        cell = self._cell
        late_s = 1e-3 * max(0.0, cell.latency_ms + self._rng.uniform(-1.0, 1.0) * cell.jitter_ms)
        q = multiply_quaternions(self._tilt, target.q_wxyz)
        world.aim(replace(target, q_wxyz=q, t_s=target.t_s + late_s), after_s=late_s)

    def _lamp(self, camera: Camera) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The lamp's pixels in a picture, as (columns, rows)."""
        r, sensor = LAMP_RADIUS_PX, camera.sensor
        u = int(self._rng.integers(r, sensor.width_px - r))
        v = int(self._rng.integers(r, sensor.height_px - r))
        y, x = np.mgrid[-r : r + 1, -r : r + 1]
        inside = x * x + y * y <= r * r
        return u + x[inside], v + y[inside]

    def _flicker(
        self, lamp: tuple[NDArray[np.int64], NDArray[np.int64]], like: Events, start_us: int, end_us: int
    ) -> Events:
        """One event of each pixel for each rise and fall."""
        xs, ys = lamp
        half_us = round(0.5e6 / LAMP_HZ)
        swings = np.arange(-(-start_us // half_us), -(-end_us // half_us))
        t = swings[:, None] * half_us + self._rng.integers(0, SWING_US, (len(swings), len(xs)))
        t = np.clip(t, start_us, end_us - 1).ravel()
        on = np.repeat(swings % 2 == 0, len(xs))
        order = np.argsort(t, kind="stable")
        x, y = (np.tile(one, len(swings))[order].astype(np.uint16) for one in (xs, ys))
        return Events.from_columns(t[order], x, y, on[order], like.sensor)


def wrong_cameras(cell: Cell, cameras: Mapping[str, Camera], rng: np.random.Generator) -> dict[str, Camera]:
    """The cameras as a calibration has them that is as wrong as the cell says."""
    return {name: _wrong(cell, camera, rng) for name, camera in cameras.items()}


def _wrong(cell: Cell, camera: Camera, rng: np.random.Generator) -> Camera:
    angle = rng.uniform(0, 2 * math.pi)
    K, T = camera.K.copy(), camera.T_world_camera.copy()
    K[:2, 2] += cell.pixels * np.array([math.cos(angle), math.sin(angle)])
    T[:3, :3] = T[:3, :3] @ _turn(cell.degrees, rng).as_matrix()
    return replace(camera, K=K, T_world_camera=T)


def _turn(degrees: float, rng: np.random.Generator) -> Rotation:
    """By an angle about any axis."""
    return Rotation.from_rotvec(math.radians(degrees) * random_direction(rng))


def _later(events: Events, by_us: int) -> Events:
    return Events.from_columns(events.t_us + by_us, events.x_px, events.y_px, events.on, events.sensor)


def _joined(one: Events, other: Events) -> Events:
    t, x, y, on = (
        np.concatenate([getattr(one, name), getattr(other, name)]) for name in ("t_us", "x_px", "y_px", "on")
    )
    order = np.argsort(t, kind="stable")
    return Events.from_columns(t[order], x[order], y[order], on[order], one.sensor)


STEPS: Final = 12
STEP_M: Final = 0.05
"""To the side, from the resting place."""
TAKES_S: Final = 0.25
WATCHED_S: Final = 0.5
"""From the command on: latencies of up to 0.2 s are seen."""
REST_S: Final = 1.5
"""Time for the way back, s."""


def measure_steps(
    world: SimulatedWorld, command: Callable[[SimulatedWorld, RacketTarget], None], steps: int = STEPS
) -> CommandLatency:
    """Send the racket `steps` times to the side and back.

    Raises:
        ConfigError: if it does not move.
    """
    return command_latency([_step(world, command, STEP_M if k % 2 else -STEP_M) for k in range(steps)])


def _step(world: SimulatedWorld, command: Callable[[SimulatedWorld, RacketTarget], None], aside_m: float) -> RacketStep:
    sent_s, start = world.now_us * 1e-6, world.rally.racket.p_m.copy()
    there = start + np.array([0.0, aside_m, 0.0])
    q = base_orientation(world.config.task.stroke)
    command(world, RacketTarget(there, q, np.zeros(3), sent_s + TAKES_S))
    times, places = [], []
    while world.now_us * 1e-6 < sent_s + WATCHED_S:
        block = world.advance()
        times.append(1e-6 * block.racket_t_us)
        places.append(block.racket[:, :3])
    world.aim(None)
    while world.now_us * 1e-6 < sent_s + WATCHED_S + REST_S:
        world.advance()
    return RacketStep(sent_s, sent_s + TAKES_S, start, there, np.concatenate(times), np.concatenate(places))


Array = NDArray[np.float64]

SEED: Final = 20261124
BALLS: Final = 10
"""Of a session."""
MAX_SIGMAS: Final = 2.0
"""What a constant of a lab is drawn within, where the row does not say."""
SPEEDS_MPS: Final = (3.0, 9.0)
CONSTANTS: Final = ("drag", "restitution", "friction")


@dataclass(frozen=True, slots=True)
class CellSession:
    """A piece of work: balls of a cell."""

    cell: Cell
    number: int
    balls: int = BALLS


@dataclass(frozen=True, slots=True)
class PlayedSession:
    """What came of its balls."""

    returned: tuple[bool, ...]
    cases: tuple[str, ...]
    landing_m: tuple[float | None, ...]
    """From the goal to where a returned ball landed; None for others."""
    latency_error_ms: float | None
    """Of the step test; None without one."""


def play_session(session: CellSession, control: TaskControl | None = None) -> PlayedSession:
    """Play the balls of a session; which balls they are depends on its number alone."""
    cell, task = session.cell, task_profile("real")
    seed, rng = [SEED, session.number], np.random.default_rng([SEED, session.number, 1])
    task = replace(task, physics=lab_physics(cell, task.physics, rng))
    world, cameras = WorldConfig(task=task), stereo_preset()
    believed, wires = wrong_cameras(cell, cameras, rng), WrongWires(cell, cameras, rng)
    lead_ms, off_ms, jitter_s = _lead(cell, world, wires)
    loop = ClosedLoop(
        world,
        cameras,
        seed=int(np.random.SeedSequence(seed).generate_state(1)[0]),
        controller=_controller(cell, task, lead_ms),
        knows_physics=bool(cell.told),
        believed=believed,
        between=wires,
    )
    loop.player.freeze_s = FREEZE_S + JITTERS * jitter_s
    goal = BuiltInController(task).goal_m
    speeds = np.random.default_rng([SEED, session.number, 2]).uniform(*SPEEDS_MPS, session.balls)
    played: list[PlayedBall] = []
    try:
        for speed in speeds.tolist():
            wires.begin_ball(loop.world.now_us)
            played.append(loop.play(speed))
            if control is not None:
                control(len(played) / session.balls)
    finally:
        loop.close()
    landings = [float(np.linalg.norm(ball.judged.outcome.landing_m[:2] - goal)) for ball in played]
    return PlayedSession(
        returned=tuple(ball.returned for ball in played),
        cases=tuple(ball.judged.outcome.case.name.lower() for ball in played),
        landing_m=tuple(
            landing if ball.returned and math.isfinite(landing) else None
            for ball, landing in zip(played, landings, strict=True)
        ),
        latency_error_ms=off_ms,
    )


def lab_physics(cell: Cell, real: PhysicsConfig, rng: np.random.Generator) -> PhysicsConfig:
    """What air and table of a lab really are: drawn from what is expected, but for the constant of the cell, which is
    as far off as that says, up or down; the other two are as expected then.
    """
    signs = np.sign(rng.standard_normal(3))
    drawn = np.clip(rng.standard_normal(3), -MAX_SIGMAS, MAX_SIGMAS)
    if cell.constant is not None:
        drawn = np.where([name == cell.constant for name in CONSTANTS], signs * cell.sigmas, 0.0)
    drag, restitution, friction = (
        UNKNOWN[name] + float(by) * UNKNOWN[f"{name}_sigma"] for name, by in zip(CONSTANTS, drawn, strict=True)
    )
    expected = expected_physics(real)
    table = replace(expected.table, restitution=min(restitution, 0.995), friction=max(friction, 0.05))
    return replace(expected, air=replace(expected.air, drag_coefficient=drag), table=table)


def _lead(cell: Cell, world: WorldConfig, wires: WrongWires) -> tuple[float, float | None, float]:
    """By how much the controller leads, and how wrong the step test was, both in ms; the jitter that it found."""
    if not cell.latency_ms or not cell.led:
        return 0.0, None, 0.0
    tested = SimulatedWorld(world, {}, 0, threads=1)
    try:
        found = measure_steps(tested, wires.command)
    finally:
        tested.close()
    return max(0.0, 1e3 * found.mean_s), 1e3 * found.mean_s - cell.latency_ms, found.jitter_s


def _controller(cell: Cell, task: TaskConfig, lead_ms: float) -> BuiltInController:
    if not cell.told:
        task = replace(task, physics=expected_physics(task.physics))
    return BuiltInController(task, ControllerConfig(lead_ms=lead_ms))


Row = Mapping[str, object]

ABOUT: Final = """Rallies through two simulated 1280x720 event cameras of the `side` placement, detector `refined`,
serves of 3 to 9 m/s without spin, drawn evenly, the built-in controller aimed at (0.8, 0) m, the racket of the profile
`real` (the controller knows its rubber in every row). Sessions of {session} balls: in each, drag, restitution and
friction of the lab are drawn about what is published ({constants}), and chain and controller are told nothing of that:
they begin with what is published and learn from ball to ball. Rows that are told something exactly have it under
*told*. A row with a constant off has the other two as published. Signs, directions, cameras and instants are drawn for
each session, the racket's tilt and the blocked 20 ms for each ball; serves are the same in all rows. Late commands: the
racket hears of a command so much later, and takes so much longer. *Led*: a step test of {steps} steps before the
session says by how much, and the controller sends the racket so much earlier;
where that differs from command to command the last decision stands longer. Flicker: events of a disc of 81 pixels,
two bursts of 1 ms in 10 ms, laid over each picture. Landing: from where a returned ball lands to the goal.
Intervals are Wilson's, 95 %."""
TITLES: Final = ("wrong", "told", "balls", "returned % (95 %)", "net/out/own half/missed", "landing mm, median (p95)")


def write_robustness_report(
    rows: Sequence[Row],
    machine: Mapping[str, object],
    *,
    seed: int,
    session: int,
    steps: int,
    constants: str,
) -> str:
    """The page as Markdown."""
    balls = max((int(str(row["balls"])) for row in rows), default=0)
    parts = [
        "# What it costs to know the constants only roughly",
        f"Made by `rallyscope bench robustness --balls {balls} --folder FOLDER --report"
        f" docs/measured/robustness-report.md` (seed {seed}; {machine_words(machine)}).",
        ABOUT.format(session=session, steps=steps, constants=constants),
        markdown_table(TITLES, [_cells(row) for row in _ordered(rows)]).rstrip(),
    ]
    steps_off = [f"{row['words']}: {_signed(row['latency_error_ms'])} ms" for row in rows if row["latency_error_ms"]]
    if steps_off:
        parts.append(f"Largest error of a step test: {'; '.join(steps_off)}.")
    return "\n\n".join(parts) + "\n"


def _ordered(rows: Sequence[Row]) -> list[Row]:
    places = {cell.name: number for number, cell in enumerate(CELLS)}
    return sorted(rows, key=lambda row: places[str(row["row"])])


def _cells(row: Row) -> list[str]:
    share, low, high = (100 * float(str(row[name])) for name in ("returned", "returned_low", "returned_high"))
    landing = "-"
    if row["landing_mm_median"] is not None:
        landing = f"{two_digits(row['landing_mm_median'])} ({two_digits(row['landing_mm_p95'])})"
    return [
        str(row["words"]),
        str(row["told"]) or "-",
        str(row["balls"]),
        f"{share:.0f} ({low:.0f}-{high:.0f})",
        "/".join(str(row[case]) for case in ("net", "out", "own_half", "missed")),
        landing,
    ]


def _signed(value: object) -> str:
    return f"{float(str(value)):+.1f}"


FOLDER: Final = Path("rallyscope-data/bench-robustness")
BALLS_PER_ROW: Final = 100


def run(
    progress: Callable[[float], None],
    *,
    balls: int = BALLS_PER_ROW,
    only: str | None = None,
    folder: Path = FOLDER,
    report: Path | None = None,
    engine: JobBackend = HERE,
) -> dict[str, object]:
    """A row per cell, or the one called `only`, and the machine."""
    cells = _chosen(only)
    wanted = [
        CellSession(cell, number, min(BALLS, balls - number * BALLS))
        for number in range(-(-balls // BALLS))
        for cell in cells
    ]
    played = {session: _kept(folder, session) for session in wanted}
    missing = [session for session in wanted if played[session] is None]

    def done(number: int, result: PlayedSession) -> None:
        played[missing[number]] = result
        _keep(folder, missing[number], result)
        report_rows_to(progress, [_row(missing[number].cell, [result])], 1 - (len(missing) - number - 1) / len(wanted))

    with open_jobs(engine if missing else ALONE, max(1, len(missing))) as jobs:
        jobs.run(play_session, missing, name=lambda one: f"{one.cell.name} {one.number}", done=done, progress=progress)
    rows = [
        _row(cell, [found for session, found in played.items() if session.cell == cell and found is not None])
        for cell in cells
    ]
    machine = describe_machine("numba", "numpy", "mujoco", clock="no times are measured")
    if report is not None:
        constants = ", ".join(f"{name} {UNKNOWN[name]:g} +- {UNKNOWN[f'{name}_sigma']:g}" for name in CONSTANTS)
        page = write_robustness_report(rows, machine, seed=SEED, session=BALLS, steps=STEPS, constants=constants)
        replace_file(report, page.encode(), durable=False)
    return {"rows": rows, "machine": machine}


def _chosen(only: str | None) -> tuple[Cell, ...]:
    found = tuple(cell for cell in CELLS if only in (None, cell.name))
    if not found:
        expected = ", ".join(cell.name for cell in CELLS)
        raise CommandError("no such row", expected=expected, got=only, where="--only")
    return found


def _row(cell: Cell, sessions: Sequence[PlayedSession]) -> dict[str, object]:
    returned = [one for session in sessions for one in session.returned]
    cases = Counter(case for session in sessions for case in session.cases)
    landing_mm = [1e3 * one for session in sessions for one in session.landing_m if one is not None]
    off_ms = [session.latency_error_ms for session in sessions if session.latency_error_ms is not None]
    share = sum(returned) / len(returned)
    low, high = binomial_interval(share, len(returned))
    return {
        "row": cell.name,
        "words": cell.words,
        "told": cell.told,
        "balls": len(returned),
        "returned": share,
        "returned_low": low,
        "returned_high": high,
        "landing_mm_median": float(np.median(landing_mm)) if landing_mm else None,
        "landing_mm_p95": float(np.percentile(landing_mm, 95)) if landing_mm else None,
        **{case.name.lower(): cases[case.name.lower()] for case in (Case.NET, Case.OUT, Case.OWN_HALF, Case.MISSED)},
        "latency_error_ms": max(off_ms, key=abs) if off_ms else None,
    }


def _path(folder: Path, session: CellSession) -> Path:
    return folder / f"{session.cell.name}-{SEED}-{session.number:03d}-{session.balls}.json"


def _kept(folder: Path, session: CellSession) -> PlayedSession | None:
    path = _path(folder, session)
    if not path.exists():
        return None
    read = parse_json(path.read_text(encoding="utf-8"))
    return PlayedSession(
        tuple(read["returned"]), tuple(read["cases"]), tuple(read["landing_m"]), read["latency_error_ms"]
    )


def _keep(folder: Path, session: CellSession, played: PlayedSession) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    replace_file(_path(folder, session), json.dumps(asdict(played)).encode(), durable=False)
