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
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine, machine_words, report_rows_to, two_digits, within
from core.cameras import Camera, stereo_preset
from core.files import replace_file
from core.learning.config import EnvironmentConfig, environment_profile
from core.learning.task.environment import draw_serve_batch, play, strokes_of
from core.live.worlds.simulated_backend import SimulatedBackend
from core.live.worlds.world import Block, ClassifiedBall
from core.metrics.score import binomial_interval
from core.outcomes import ClassifiedStroke, OutcomeClassifier, ServeSeen
from core.outcomes.ball_log import BallPoints
from core.outcomes.environment_backend import EnvironmentBackend, SeenBlock
from core.outcomes.perceived_backend import PerceivedBackend
from core.physics.config import Profile
from core.physics.episode import Case, Outcomes
from core.simulation.episodes.episode_path import Trajectory, trace_episode
from core.simulation.episodes.racket import RacketTarget
from core.text import markdown_table, parse_json

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackNoise:
    """Noise of the chain with the detector `refined` and cameras of the `side` placement, measured on the outgoing
    flights of 59 balls, which no figure is made of. In millimetres along x, y, z.
    """

    bias_mm: tuple[float, float, float] = (0.15, 0.17, 0.19)
    """Root mean square over flights; the mean, which is not zero, counts as bias."""
    drift_mm: tuple[float, float, float] = (0.09, 0.21, 0.18)
    drift_s: float = 0.006
    noise_mm: tuple[float, float, float] = (0.07, 0.09, 0.06)
    said_mm: tuple[float, float, float] = (0.13, 0.36, 0.22)
    """What the points say of themselves."""
    period_s: float = 0.002
    hidden_s: float = 0.010
    """After the racket nothing is seen."""
    lost: float = 0.0
    """Share of points that are missing, by chance."""
    strays: float = 0.0
    """Share of points that are somewhere else, up to 10 cm off."""


@dataclass(frozen=True, slots=True, eq=False)
class NoisyBall:
    """One ball: what is seen of it, and what became of it."""

    points: BallPoints
    case: Case
    outcome: Outcomes
    path: Trajectory
    speed_mps: float

    @property
    def hit_s(self) -> float | None:
        """When it was struck, after the launch; None for a ball that was not."""
        return next((event.t_s for event in self.path.events if event.kind == "hit"), None)


def draw_ball(
    environment: EnvironmentConfig,
    rng: np.random.Generator,
    *,
    noise: TrackNoise | None = None,
    cameras: dict[str, Camera] | None = None,
    missed: float = 0.05,
    until_s: float = 4.0,
) -> NoisyBall:
    """A serve of 3 to 9 m/s, a stroke anywhere in the range of actions or (a share `missed`) none, and its points."""
    speed_mps = float(rng.uniform(3, 9))
    ball = draw_serve_batch(speed_mps, 1, environment, rng)
    action = rng.uniform(-1, 1, (1, 3))
    struck = rng.random() >= missed
    strokes = strokes_of(ball, action, environment) if struck else None
    path = trace_episode(ball.serves, strokes, environment.task, duration_s=until_s)
    outcome = play(ball, action, environment)
    case = Case(int(outcome.case[0])) if struck else Case.MISSED
    points = see_path(path, noise or TrackNoise(), stereo_preset() if cameras is None else cameras, rng)
    return NoisyBall(points, case, outcome, path, speed_mps)


def see_path(path: Trajectory, noise: TrackNoise, cameras: dict[str, Camera], rng: np.random.Generator) -> BallPoints:
    """The points of a path that all cameras have in their picture; times count from the launch."""
    t_s = np.arange(path.start_s + float(rng.uniform(0, noise.period_s)), path.end_s, noise.period_s)
    truth = path.at(t_s)[:, :3]
    seen = rng.random(len(t_s)) >= noise.lost
    for camera in cameras.values():
        uvs = camera.project(truth)
        inside = (uvs >= 5) & (uvs < np.array([camera.sensor.width_px, camera.sensor.height_px]) - 5)
        seen &= np.isfinite(uvs).all(axis=1) & inside.all(axis=1)
    for event in path.events:
        if event.kind == "hit":
            seen &= (t_s < event.t_s) | (t_s > event.t_s + noise.hidden_s)
    n = len(t_s)
    drift = rng.standard_normal((n, 3))
    kept = np.exp(-noise.period_s / noise.drift_s)
    for i in range(1, n):
        drift[i] = kept * drift[i - 1] + np.sqrt(1 - kept**2) * drift[i]
    errors_mm = np.array(noise.drift_mm) * drift + np.array(noise.noise_mm) * rng.standard_normal((n, 3))
    errors_mm += np.array(noise.bias_mm) * rng.standard_normal(3)
    strays = rng.random(n) < noise.strays
    errors_mm[strays] += rng.uniform(-100, 100, (int(strays.sum()), 3))
    covariance = np.diag((1e-3 * np.array(noise.said_mm)) ** 2)
    ps = (truth + 1e-3 * errors_mm)[seen]
    return BallPoints(0, t_s[seen], ps, np.tile(covariance, (len(ps), 1, 1)))


UNSURE: Final = 0.9
"""A judgement of a lower probability says itself that it may be wrong."""


@dataclass(frozen=True, slots=True)
class ComparedBall:
    """One ball; lengths in metres, NaN (null in a file) where there is nothing to compare."""

    speed_mps: float
    told: int
    judged: int
    probability: float
    landing_error_m: float
    landing_squared: float
    """Squared error of the landing over its covariance, per coordinate: 1 on average if the covariance is honest."""
    net_error_m: float
    net_squared: float
    hit_error_s: float
    serve_error_mps: float
    serve_late_s: float
    points: int
    late_s: float
    """From the first contact, as told, to the judgement."""


def compare_ball(
    judged: ClassifiedStroke | None,
    serve: ServeSeen | None,
    *,
    told: Case,
    landing_m: Array,
    net_z_m: float,
    hit_s: float,
    decided_s: float,
    speed_mps: float,
    launch_mps: float,
    launch_s: float,
) -> ComparedBall:
    """The judgement beside what was told; no judgement counts as a wrong one. Times in seconds of the same clock."""
    nan = math.nan
    both = judged is not None and judged.case is not Case.MISSED and told is not Case.MISSED
    off = judged.landing_m[:2] - landing_m[:2] if both and judged is not None else np.full(2, nan)
    squared = nan
    if judged is not None and np.isfinite(off).all():
        squared = float(off @ np.linalg.solve(judged.landing_covariance_m2, off)) / 2
    net = judged.net_z_m - net_z_m if both and judged is not None else nan
    return ComparedBall(
        speed_mps=speed_mps,
        told=int(told),
        judged=0 if judged is None else int(judged.case),
        probability=0.0 if judged is None else judged.probability,
        landing_error_m=float(np.linalg.norm(off)),
        landing_squared=squared,
        net_error_m=net,
        net_squared=nan if judged is None else (net / judged.net_sigma_m) ** 2,
        hit_error_s=nan if judged is None or not both else judged.hit_us * 1e-6 - hit_s,
        serve_error_mps=nan if serve is None else serve.speed_mps - launch_mps,
        serve_late_s=nan if serve is None else serve.t_us * 1e-6 - launch_s,
        points=0 if judged is None else judged.points,
        late_s=nan if judged is None else judged.t_us * 1e-6 - decided_s,
    )


def outcome_row(name: str, physics: str, balls: Sequence[ComparedBall]) -> dict[str, object]:
    """The figures of many balls."""
    agree = np.array([one.told == one.judged for one in balls])
    share = float(agree.mean())
    low, high = binomial_interval(share, len(balls))
    unsure = np.array([one.probability < UNSURE for one in balls])
    return {
        "seen_through": name,
        "physics": physics,
        "balls": len(balls),
        "agree": share,
        "agree_low": low,
        "agree_high": high,
        "sure": int((~unsure).sum()),
        "sure_and_wrong": int((~unsure & ~agree).sum()),
        "landing_mm_median": _millimetres(balls, "landing_error_m", 50),
        "landing_mm_p95": _millimetres(balls, "landing_error_m", 95),
        "landing_nees": _mean([one.landing_squared for one in balls]),
        "landing_nees_median": _percentile([one.landing_squared for one in balls], 50),
        "net_mm_median": _millimetres(balls, "net_error_m", 50),
        "net_nees": _mean([one.net_squared for one in balls]),
        "hit_ms_p95": _scaled(_percentile([abs(one.hit_error_s) for one in balls], 95)),
        "serve_mps_median": _percentile([abs(one.serve_error_mps) for one in balls], 50),
        "serve_mps_p95": _percentile([abs(one.serve_error_mps) for one in balls], 95),
        "serve_late_ms_median": _scaled(_percentile([one.serve_late_s for one in balls], 50)),
        "judged_after_ms_median": _scaled(_percentile([one.late_s for one in balls], 50)),
        "cases": _cases(balls),
    }


def read_ball(values: Mapping[str, object]) -> ComparedBall:
    """A record as it was written."""
    plain = {name: math.nan if value is None else value for name, value in values.items()}
    return ComparedBall(**plain)  # type: ignore[arg-type]


def _cases(balls: Sequence[ComparedBall]) -> str:
    """Agreed of told, by case."""
    told = Counter(one.told for one in balls)
    right = Counter(one.told for one in balls if one.told == one.judged)
    return ", ".join(f"{case.name.lower()} {right[case]}/{told[case]}" for case in Case if told[case])


def _mean(values: Sequence[float]) -> float | None:
    known = [value for value in values if math.isfinite(value)]
    return float(np.mean(known)) if known else None


def _percentile(values: Sequence[float], share: float) -> float | None:
    known = [value for value in values if math.isfinite(value)]
    return float(np.percentile(known, share)) if known else None


def _scaled(value: float | None) -> float | None:
    return None if value is None else 1e3 * value


def _millimetres(balls: Sequence[ComparedBall], name: str, share: float) -> float | None:
    return _scaled(_percentile([abs(getattr(one, name)) for one in balls], share))


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


class IdleRacketBackend:
    """Another backend, whose racket does not move."""

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
        """Start the wrapped backend anew."""
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
    drawn = draw_serve_batch(speed_mps, 1, environment, rng)
    action = rng.uniform(-1, 1, (1, 3)) * (1.0 if rng.random() < 0.5 else 0.3)
    called_off = rng.random() < CALLED_OFF
    told.forget()
    ball = backend.observe(drawn)
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
        launch_mps=float(np.linalg.norm(drawn.serves.vs_mps[0])),
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
