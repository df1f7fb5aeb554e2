"""Outcomes judged by perception beside those that the simulation tells: case, landing, height at the net, serve.

Three rows for each physics. `cameras`: simulated events of two cameras, the whole chain, nothing told; half of the
strokes are anywhere in the range of actions, half near the middle, and some are called off 50 ms before the ball.
`cameras, idle racket`: a tenth as many balls, and the racket stays at rest. `points`: no cameras, balls of the
closed-form simulation with the noise that the chain's points were measured to have; many more of them. Seeds are fixed,
and none of them was used while the judge was made.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine, machine_words
from benchmarks.partial_rows import report_rows_to, within
from benchmarks.rally.noisy_tracks import NoisyBall, draw_ball
from benchmarks.rally.outcome_rows import ComparedBall, compare_ball, outcome_row, read_ball
from core.cameras import Camera, stereo_preset
from core.files import replace_file
from core.learning.config import EnvironmentConfig, environment_profile
from core.learning.task.environment import draw_serve_batch
from core.live.worlds.simulated_backend import SimulatedBackend
from core.live.worlds.world import Block, ClassifiedBall
from core.outcomes import ClassifiedStroke, OutcomeClassifier
from core.outcomes.environment_backend import EnvironmentBackend, SeenBlock
from core.outcomes.perceived_backend import PerceivedBackend
from core.physics.config import Profile
from core.simulation.episodes.racket import RacketTarget
from core.text.json_text import parse_json
from core.text.markdown_table import markdown_table, two_digits

ABOUT: Final = """What came of a stroke, judged from the chain's points alone (`core.outcomes`), beside what the
simulation tells. Serves of 3 to 9 m/s, drawn evenly. `cameras`: simulated events of two 1280x720 cameras of the `side`
placement, detector `refined`, calibration exact; strokes with actions from the whole range (half of them) and from its
middle, 8 % of them called off 50 ms before the ball. `cameras, idle racket`: the same, and the racket stays at rest.
`points`: no cameras; the same physics in closed form, and points with the noise that was measured of the first row's
chain, nothing for 10 ms after the racket, 5 % without a stroke. Neither chain nor judge is told air or table: the
points decide between flights with air and without. Landing: where the ball comes down to the table's plane, from where
the simulation says, over balls that both say were struck. NEES: mean squared error over the covariance, per coordinate
(1 is honest, less is too careful). The serve's speed is that at which it was first seen, from that at its launch.
Intervals are Wilson's, 95 %."""
TITLES: Final = (
    "seen through", "physics", "balls", "agree % (95 %)", "sure (p >= .9), of these wrong", "landing mm, median (p95)",
    "NEES", "net mm, median", "hit ms, p95", "serve m/s, median (p95)",
)  # fmt: skip


def write_outcomes_report(rows: Sequence[Mapping[str, object]], machine: Mapping[str, object], seed: int) -> str:
    """The page as Markdown."""
    parts = [
        "# Outcomes that the cameras see",
        f"Made by `rallyscope bench outcomes --balls {rows[0]['balls']} --count {rows[-1]['balls']} --report"
        f" docs/measured/outcomes-report.md` (seed {seed}; {machine_words(machine)}).",
        ABOUT,
        markdown_table(TITLES, [_cells(row) for row in rows]).rstrip(),
        "Agreed of told, by case:",
        "\n".join(f"- {row['seen_through']}, {row['physics']}: {row['cases']}." for row in rows),
    ]
    return "\n\n".join(parts) + "\n"


def _cells(row: Mapping[str, object]) -> list[str]:
    low, high = (100 * float(str(row[name])) for name in ("agree_low", "agree_high"))
    return [
        str(row["seen_through"]),
        str(row["physics"]),
        str(row["balls"]),
        f"{100 * float(str(row['agree'])):.1f} ({low:.1f}-{high:.1f})",
        f"{row['sure']}, {row['sure_and_wrong']}",
        f"{two_digits(row['landing_mm_median'])} ({two_digits(row['landing_mm_p95'])})",
        two_digits(row["landing_nees"]),
        two_digits(row["net_mm_median"]),
        two_digits(row["hit_ms_p95"]),
        f"{two_digits(row['serve_mps_median'])} ({two_digits(row['serve_mps_p95'])})",
    ]


Array = NDArray[np.float64]


class IdleRacketBackend:
    """Another court, but for the racket."""

    def __init__(self, world_backend: EnvironmentBackend) -> None:
        self._world_backend = world_backend

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """Value of the wrapped backend."""
        return self._world_backend.cameras

    @property
    def now_us(self) -> int:
        """Value of the wrapped backend."""
        return self._world_backend.now_us

    def begin(self, seed: int) -> None:
        """Start the other court anew."""
        self._world_backend.begin(seed)

    def serve(self, p_m: Array, v_mps: Array, spin_radps: Array) -> None:
        """Serve there."""
        self._world_backend.serve(p_m, v_mps, spin_radps)

    def aim(self, target: RacketTarget | None) -> None:
        """Nothing moves."""

    def advance(self) -> SeenBlock:
        """What is seen there."""
        return self._world_backend.advance()

    def close(self) -> None:
        """Close it."""
        self._world_backend.close()


BALLS: Final = 40
"""Through the cameras; each takes some seconds."""
POINTS: Final = 500
"""Of points alone."""
SEED: Final = 20261123
CHUNK: Final = 10
"""Balls that are kept together in a file."""
CALLED_OFF: Final = 0.08
"""Share of strokes that are called off when they are decided: the racket goes to rest, and may still meet the ball."""
WAIT_US: Final = 3_000_000
"""For what the simulation tells, after the judgement."""


def run(
    progress: Callable[[float], None],
    *,
    balls: int = BALLS,
    count: int = POINTS,
    physics: Profile | None = None,
    folder: Path | None = None,
    report: Path | None = None,
) -> dict[str, object]:
    """For each physics, or one, a row of `balls` through cameras and one of `count` of points.

    What is in `folder` is not measured again.
    """
    names: tuple[Profile, ...] = ("paper", "real") if physics is None else (physics,)
    rows: list[dict[str, object]] = []
    for number, name in enumerate(names):
        done, share = number / len(names), 1 / len(names)
        spans = ((0.0, 0.8), (0.8, 0.9), (0.9, 1.0))
        cameras, idle, points = (within(progress, done + share * a, done + share * b) for a, b in spans)
        rows.append(outcome_row("cameras", name, measure_cameras(name, balls, cameras, folder)))
        report_rows_to(progress, rows[-1:], done + 0.8 * share)
        past = measure_cameras(name, math.ceil(balls / 10), idle, folder, idle=True)
        rows.append(outcome_row("cameras, idle racket", name, past))
        report_rows_to(progress, rows[-1:], done + 0.9 * share)
        rows.append(outcome_row("points", name, measure_points(name, count, points)))
        report_rows_to(progress, rows[-1:], done + share)
    machine = describe_machine("numba", "numpy", "mujoco", clock="no times are measured")
    if report is not None:
        replace_file(report, write_outcomes_report(rows, machine, SEED).encode(), durable=False)
    return {"rows": rows, "machine": machine}


def measure_cameras(
    physics: Profile,
    balls: int,
    progress: Callable[[float], None],
    folder: Path | None = None,
    *,
    idle: bool = False,
) -> list[ComparedBall]:
    """Balls of which simulated events are seen, judged and told; tens of them are kept in `folder`."""
    found: list[ComparedBall] = []
    for first in range(0, balls, CHUNK):
        path = None if folder is None else _chunk_file(folder, physics, first, idle=idle)
        chunk = _kept_chunk(path) or _measure_chunk(physics, first, idle=idle)
        _keep_chunk(path, chunk)
        found += chunk[: balls - first]
        progress(min(1.0, (first + CHUNK) / balls))
    return found


def measure_points(physics: Profile, count: int, progress: Callable[[float], None]) -> list[ComparedBall]:
    """Balls of the closed-form simulation, of which noisy points are judged."""
    environment = environment_profile(physics, state_source="truth")
    rng, cameras = np.random.default_rng([SEED, 1]), stereo_preset()
    found = []
    for number in range(count):
        ball = draw_ball(environment, rng, cameras=cameras)
        found.append(_compare_noisy(ball, OutcomeClassifier(hit_x_m=environment.task.stroke.hit_plane_x_m)))
        progress((number + 1) / count)
    return found


def judge_points(ball: NoisyBall, judge: OutcomeClassifier) -> ClassifiedStroke | None:
    """The final judgement of a noisy track, or the last one after a while without points."""
    judge.begin()
    points = ball.points
    times_us = np.round(1e6 * points.t_s).astype(np.int64) + points.start_us
    for t_us, p, covariance in zip(times_us.tolist(), points.ps_m, points.covariances_m2, strict=True):
        found = judge.add(t_us, p, covariance)
        if found is not None:
            return found
    for step in range(1, 21):
        found = judge.look((int(times_us[-1]) if len(times_us) else 0) + 100_000 * step)
        if found is not None:
            return found
    return judge.newest


def _compare_noisy(ball: NoisyBall, judge: OutcomeClassifier) -> ComparedBall:
    judged = judge_points(ball, judge)
    outcome, hit_s = ball.outcome, ball.hit_s
    decided = [event.t_s for event in ball.path.events if hit_s is not None and event.t_s > hit_s]
    return compare_ball(
        judged,
        judge.serve,
        told=ball.case,
        landing_m=outcome.landings_m[0],
        net_z_m=float(outcome.net_z_m[0]),
        hit_s=math.nan if hit_s is None else hit_s,
        decided_s=decided[0] if decided else math.nan,
        speed_mps=ball.speed_mps,
        launch_mps=float(np.linalg.norm(ball.path.at(0.0)[3:6])),
        launch_s=0.0,
    )


class _SimulatedOutcome:
    """What the simulation tells of one ball."""

    def __init__(self) -> None:
        self.ball: ClassifiedBall | None = None
        self.hit_s = math.nan

    def __call__(self, block: Block) -> None:
        if block.outcomes:
            self.ball = block.outcomes[-1]
        for contact in block.contacts:
            if contact.event.kind == "hit" and math.isnan(self.hit_s):
                self.hit_s = contact.event.t_s

    def forget(self) -> None:
        self.ball, self.hit_s = None, math.nan


def _measure_chunk(physics: Profile, first: int, *, idle: bool) -> list[ComparedBall]:
    environment = dataclasses.replace(environment_profile(physics, state_source="events"), outcomes="events")
    rng, told = np.random.default_rng([SEED, 0, first]), _SimulatedOutcome()
    world_backend: EnvironmentBackend = SimulatedBackend(environment.task, seed=SEED + first, on_block=told)
    world_backend = IdleRacketBackend(world_backend) if idle else world_backend
    backend = PerceivedBackend(environment, world_backend)
    try:
        return [_play_ball(environment, rng, world_backend, backend, told) for _ in range(CHUNK)]
    finally:
        backend.close()


def _play_ball(
    environment: EnvironmentConfig,
    rng: np.random.Generator,
    world_backend: EnvironmentBackend,
    backend: PerceivedBackend,
    told: _SimulatedOutcome,
) -> ComparedBall:
    speed_mps = float(rng.uniform(3, 9))
    dealt = draw_serve_batch(speed_mps, 1, environment, rng)
    action = rng.uniform(-1, 1, (1, 3)) * (1.0 if rng.random() < 0.5 else 0.3)
    called_off = rng.random() < CALLED_OFF
    told.forget()
    ball = backend.observe(dealt)
    if called_off:
        world_backend.aim(None)
        ball = dataclasses.replace(ball, seen=np.array([False]))
    backend.play(ball, action)
    end_us = world_backend.now_us + WAIT_US
    while told.ball is None and world_backend.now_us < end_us:
        world_backend.advance()
    assert told.ball is not None, "a ball without an outcome"
    outcome = told.ball.outcome
    return compare_ball(
        backend.judged,
        backend.serve_seen,
        told=outcome.case,
        landing_m=outcome.landing_m,
        net_z_m=outcome.net_z_m,
        hit_s=told.hit_s,
        decided_s=outcome.t_s,
        speed_mps=speed_mps,
        launch_mps=float(np.linalg.norm(dealt.serves.vs_mps[0])),
        launch_s=backend.served_us * 1e-6,
    )


def _chunk_file(folder: Path, physics: Profile, first: int, *, idle: bool) -> Path:
    return folder / f"outcomes-{physics}-{'idle-' if idle else ''}{SEED}-{first:04d}.json"


def _kept_chunk(path: Path | None) -> list[ComparedBall] | None:
    if path is None or not path.exists():
        return None
    return [read_ball(one) for one in parse_json(path.read_text())]


def _keep_chunk(path: Path | None, chunk: list[ComparedBall]) -> None:
    if path is None:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    plain = [
        {name: None if value != value else value for name, value in dataclasses.asdict(one).items()} for one in chunk
    ]
    replace_file(path, json.dumps(plain).encode(), durable=False)
