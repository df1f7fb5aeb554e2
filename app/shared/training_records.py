"""The growing files of a training run: its metrics as arrays, and replays of its balls.

Serve and action come from the line of an episode; the path is the one of the closed-form simulator that judged it.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict, deque
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import ConfigError
from core.history.rally_picture import LandingSpot, Pose, RallyPicture
from core.learning.agents.policy import Policy
from core.learning.config import EnvironmentConfig
from core.learning.runs.run_files import read_lines, seed_files
from core.learning.task.drawn_worlds import HIGHEST, LOWEST, with_constants
from core.learning.task.environment import racket_speeds_of
from core.learning.task.normalise import STATE_SIZES
from core.physics.episode import Case, Outcomes, Serves, Strokes, strokes_from_actions
from core.physics.rotation import base_orientation
from core.simulation.episodes.closed_form import fly_serves, return_balls
from core.simulation.episodes.episode_path import Trajectory, trace_episode
from core.simulation.episodes.racket import RacketConfig, move_racket, target_for_ball, upright_racket
from core.text import parse_json

Array = NDArray[np.float64]
COLUMNS: Final = ("case", "reward", "error_mm", "noise", "w1", "w2", "speed_mps")
WIDTH: Final = len(COLUMNS) + 4
LARGEST: Final = 1e12
"""Largest credible number: a damaged line may hold numbers of hundreds of digits."""
RECENT: Final = 24
"""Number of complete lines kept for replays."""
FILES_KEPT: Final = 64
LAST_LINE_BYTES: Final = 1024
"""Bytes read for the last line: more than an evaluation's line."""


@dataclass(frozen=True, slots=True, eq=False)
class Metrics:
    """Episodes of one seed, in order; NaN for what is not known."""

    columns: dict[str, Array]
    """Columns (N,) by the names in COLUMNS."""
    landings_m: Array
    """Positions, (N, 2), m."""
    goals_m: Array
    """Positions, (N, 2), m."""
    evaluations: tuple[dict[str, object], ...]
    recent: tuple[dict[str, object], ...]
    """The newest lines, oldest first."""
    stage_starts: tuple[dict[str, object], ...] = ()
    """Lines with what a new stage kept of the replay buffer."""

    def __len__(self) -> int:
        return len(self.landings_m)


class MetricsReader:
    """Reads the metrics of one seed.

    A file that got shorter, because a resumed run cut off what it makes again, is read anew.
    """

    def __init__(self, run: Path, seed: int) -> None:
        self._files = seed_files(run, seed)
        self._forget()

    def read(self) -> Metrics:
        """All episodes written so far.

        Raises:
            ConfigError: if something else has written there.
        """
        if _size(self._files.metrics) < self._at or _size(self._files.evaluations) < self._evaluations_at:
            self._forget()
        try:
            return self._read_on()
        except ConfigError as error:
            self._forget()
            raise ConfigError("a broken line in the metrics", got=error, where=self._files.folder) from error

    def _read_on(self) -> Metrics:
        lines, self._at = read_lines(self._files.metrics, self._at)
        if lines:
            self._append(lines)
            self._recent.extend(lines)
            self._stage_starts.extend(line for line in lines if "kept" in line)
        more, self._evaluations_at = read_lines(self._files.evaluations, self._evaluations_at)
        self._evaluations.extend(more)
        rows = self._rows[: self._count]
        columns = {name: rows[:, k].copy() for k, name in enumerate(COLUMNS)}
        return Metrics(
            columns,
            rows[:, -4:-2].copy(),
            rows[:, -2:].copy(),
            tuple(self._evaluations),
            tuple(self._recent),
            tuple(self._stage_starts),
        )

    def _append(self, lines: list[dict[str, object]]) -> None:
        needed = self._count + len(lines)
        if needed > len(self._rows):
            grown = np.empty((max(needed, 2 * len(self._rows)), WIDTH))
            grown[: self._count] = self._rows[: self._count]
            self._rows = grown
        self._rows[self._count : needed] = [_row(line) for line in lines]
        self._count = needed

    def _forget(self) -> None:
        self._at = self._evaluations_at = self._count = 0
        self._rows = np.empty((256, WIDTH))
        self._recent: deque[dict[str, object]] = deque(maxlen=RECENT)
        self._stage_starts: list[dict[str, object]] = []
        self._evaluations: list[dict[str, object]] = []


class MetricsStore:
    """Readers of many runs, shared by all browsers; those not asked for lately are forgotten."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._readers: OrderedDict[tuple[Path, int], MetricsReader] = OrderedDict()

    def read(self, run: Path, seed: int) -> Metrics:
        """The episodes of a seed of a run; empty if there are none."""
        with self._lock:
            key = (run, seed)
            reader = self._readers.setdefault(key, MetricsReader(run, seed))
            self._readers.move_to_end(key)
            while len(self._readers) > FILES_KEPT:
                self._readers.popitem(last=False)
            return reader.read()


def last_line(path: Path) -> dict[str, object] | None:
    """The last complete line of a .jsonl file; None if there is none."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, _size(path) - LAST_LINE_BYTES))
            complete = file.read().split(b"\n")[:-1]
        line = parse_json(complete[-1])
    except (OSError, IndexError, ValueError):
        return None
    return line if isinstance(line, dict) else None


def _row(line: dict[str, object]) -> list[float]:
    numbers = [line.get(name) for name in COLUMNS]
    for name in ("landing_m", "goal_m"):
        point = line.get(name)
        numbers += point if isinstance(point, list) and len(point) == 2 else [None, None]
    return [number(value) for value in numbers]


def number(value: object) -> float:
    """A number of a line; NaN for anything else, or one that is not credible."""
    return float(value) if isinstance(value, (int, float)) and abs(value) < LARGEST else float("nan")


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


RACKET_STEP_S: Final = 1 / 60
TRAIL_S: Final = 0.35
TRAIL_POINTS: Final = 48
AFTER_LANDING_S: Final = 0.45
"""Time that a ball is shown after it landed."""
LONGEST_S: Final = 3.0
STATE_SHAPES: Final = tuple((size,) for size in STATE_SIZES.values())


@dataclass(frozen=True, slots=True, eq=False)
class Ball:
    """One episode for a replay."""

    serve: Array
    """(9,) position, velocity, spin at the launch."""
    goal_m: Array
    """Landing target, (2,), m."""
    state: Array | None
    """Perceived state, (6,), with spin (12,); None if the ball was not seen."""
    action: Array
    """Action with exploration noise: (3,), or (4,) with the racket's speed."""
    racket_speed_mps: float
    aim_m: Array | None
    aim_t_s: float | None
    episode: int
    speed_mps: float
    noise: float
    is_random: bool
    constants: Array | None = None
    """(5,) of a world that differs from ball to ball, `drawn_worlds.CONSTANTS`."""
    racket_errors: Array | None = None
    """(4,) what an uncertain racket added to the action's angles and to its speed, m/s."""


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Replay of a ball from the launch until shortly after its landing."""

    ball: Ball
    title: str
    case: Case
    error_mm: float
    path: Trajectory
    rackets: tuple[Pose, ...]
    """Racket poses, one every RACKET_STEP_S."""
    target: Pose | None
    """Racket pose at the impact."""
    duration_s: float

    def picture(self, t_s: float, spots: tuple[LandingSpot, ...]) -> RallyPicture:
        """Picture `t_s` after the launch, with earlier landing points."""
        t = min(max(t_s, 0.0), self.duration_s)
        times = np.linspace(max(0.0, t - TRAIL_S), t, TRAIL_POINTS)
        trail = self.path.at(times)[:, :3]
        racket = self.rackets[min(round(t / RACKET_STEP_S), len(self.rackets) - 1)]
        return RallyPicture(
            ball=trail[-1],
            trail=trail if t < self.path.end_s else trail[:0],
            trail_speeds_mps=np.linalg.norm(self.path.at(times)[:, 3:6], axis=1),
            racket=racket,
            racket_target=self.target,
            landing_target=self.ball.goal_m,
            spots=spots,
        )


def ball_of_line(line: dict[str, object]) -> Ball | None:
    """Ball of an episode's line; None if the line is incomplete."""
    try:
        aim = None if line.get("aim_m") is None else _vector(line["aim_m"], 3)
        aim_t = line.get("aim_t_s")
        state = np.array([math.nan if v is None else v for v in line["state"]], np.float64)  # type: ignore[union-attr]
        known = state.shape in STATE_SHAPES and bool(np.isfinite(state).all())
        return Ball(
            serve=_vector(line["serve"], 9),
            goal_m=_vector(line["goal_m"], 2),
            state=state if known else None,
            action=_vector(line["action"], 3, 4),
            racket_speed_mps=float(line["racket_speed_mps"]),  # type: ignore[arg-type]
            aim_m=aim,
            aim_t_s=float(aim_t) if isinstance(aim_t, (int, float)) else None,
            episode=int(line["episode"]),  # type: ignore[call-overload]
            speed_mps=float(line["speed_mps"]),  # type: ignore[arg-type]
            noise=float(line["noise"]) if isinstance(line.get("noise"), (int, float)) else math.nan,  # type: ignore[arg-type]
            is_random=bool(line.get("random")),
            constants=np.clip(_vector(line["constants"], len(LOWEST)), LOWEST, HIGHEST)
            if "constants" in line
            else None,
            racket_errors=_vector(line["racket_errors"], 4) if "racket_errors" in line else None,
        )
    except (KeyError, TypeError, ValueError, ConfigError):
        return None


def _constants(values: object) -> Array:
    """Constants of a ball's world, cut off at their bounds: a damaged line may hold anything."""
    return np.clip(_vector(values, len(LOWEST)), LOWEST, HIGHEST)


def replay_ball(ball: Ball, environment: EnvironmentConfig, policy: Policy | None, title: str) -> Replay:
    """Replay of a ball with its recorded action, or with a policy's action without noise."""
    task = environment.task if ball.constants is None else with_constants(environment.task, ball.constants)
    serves = Serves(ball.serve[None, :3], ball.serve[None, 3:6], ball.serve[None, 6:])
    action = ball.action
    if policy is not None and ball.state is not None:
        action = policy(ball.state[None], np.array([ball.racket_speed_mps]), ball.goal_m[None])[0]
    strokes = None if ball.state is None else _strokes(ball, action, environment)
    arrivals = fly_serves(serves, task)
    case, error_mm, down_s = Case.MISSED, math.nan, math.nan
    if strokes is not None:
        outcomes = return_balls(arrivals, strokes, task)
        case = Case(int(outcomes.case[0]))
        error_mm = 1000 * float(np.hypot(*(outcomes.landings_m[0] - ball.goal_m)))
        down_s = _down_s(outcomes)
    path = trace_episode(serves, strokes, task, duration_s=LONGEST_S)
    duration_s = min(path.end_s, down_s if math.isfinite(down_s) else path.end_s) + AFTER_LANDING_S
    meets_p = arrivals.states[0, :3] if ball.aim_m is None else ball.aim_m
    meets_s = float(arrivals.t_s[0]) if ball.aim_t_s is None else ball.aim_t_s
    rackets, target = _rackets(strokes, meets_p, meets_s, environment, duration_s)
    return Replay(ball, title, case, error_mm, path, rackets, target, duration_s)


def _strokes(ball: Ball, action: Array, environment: EnvironmentConfig) -> Strokes:
    aimed = ball.aim_m is not None and ball.aim_t_s is not None
    angles, speed_mps = action[None, :3], racket_speeds_of(action[None], np.array([ball.racket_speed_mps]))
    if ball.racket_errors is not None:
        angles, speed_mps = np.clip(angles, -1, 1) + ball.racket_errors[:3], speed_mps + ball.racket_errors[3]
    return strokes_from_actions(
        angles,
        speed_mps,
        environment.task.stroke,
        aim_ps_m=ball.aim_m[None] if aimed and ball.aim_m is not None else None,
        aim_t_s=np.array([ball.aim_t_s]) if aimed else None,
    )


def _down_s(outcomes: Outcomes) -> float:
    """Time at which the outcome of the stroke is known, s."""
    return float(np.fmax(outcomes.contact_t_s[0], outcomes.landing_t_s[0]))


def _rackets(
    strokes: Strokes | None, meets_p: Array, meets_s: float, environment: EnvironmentConfig, duration_s: float
) -> tuple[tuple[Pose, ...], Pose | None]:
    """Racket poses from rest through the impact and back, as in the simulation."""
    config, home = RacketConfig(), base_orientation(environment.task.stroke)
    racket = upright_racket(config)
    target = None
    if strokes is not None and np.isfinite(meets_p).all() and math.isfinite(meets_s):
        target = target_for_ball(meets_p, strokes.qs_wxyz[0], strokes.vs_mps[0], meets_s)
    poses = [Pose(racket.p_m, racket.q_wxyz)]
    for step in range(math.ceil(duration_s / RACKET_STEP_S)):
        t = step * RACKET_STEP_S
        over = target is None or t > target.t_s + config.follow_through_s
        racket = move_racket(racket, None if over else target, t, RACKET_STEP_S, config, home)
        poses.append(Pose(racket.p_m, racket.q_wxyz))
    return tuple(poses), None if target is None else Pose(target.p_m, target.q_wxyz)


def _vector(values: object, *lengths: int) -> Array:
    vector = np.array(values, np.float64)
    if vector.ndim != 1 or len(vector) not in lengths or not np.isfinite(vector).all():
        raise ValueError(f"not {lengths[0]} numbers")
    return vector
