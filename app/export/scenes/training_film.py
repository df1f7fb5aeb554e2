"""A film of a whole training: every tenth ball in order, from the first misses to the last, drawn without a browser."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from app.export.scenes.drawn_scene import SceneDrawing
from app.export.task import RunTask
from app.export.unfinished import check_cancelled
from app.scene.prediction import CASE_NAMES, CASE_RGB, REACH_M, SPOTS
from app.scene.view_camera import standpoint
from app.shared.training_records import AFTER_LANDING_S, Replay, ball_of_line, number, replay_ball
from core.errors import CommandError
from core.events import SensorSize
from core.extras import require_package
from core.history.rally_picture import LandingSpot
from core.learning.runs.run_files import read_lines, read_run, seed_files
from core.physics.episode import Case

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
SIZE: Final = SensorSize(1280, 720)
FRAMES_PER_S: Final = 25.0
"""Frame rate; balls fly at their real speed."""
EVERY: Final = 10
"""One ball of this many is shown, and the last one."""
MAX_BALLS: Final = 300
"""About the most balls shown: ten minutes of film. Of a long training every 20th, 30th ... is shown."""
WINDOW: Final = 25
"""Balls over which the figures are averaged, as in the curves of Train."""
CHART_PX: Final = (500, 130)
MARGIN_PX: Final = 18
WORDS_PX: Final = (470, 164)
"""Size of the darker upper left corner that holds the text."""
CHART_TOP_MM: Final = 800.0
TEXT_RGB: Final = (228, 230, 234)
MUTED_RGB: Final = (150, 154, 162)
PANEL_RGB: Final = (28, 30, 36)
ERROR_RGB: Final = (255, 140, 40)
RETURNED_RGB: Final = CASE_RGB[Case.RETURNED]


@dataclass(frozen=True, slots=True, eq=False)
class FilmedBalls:
    """Data of the episodes of one seed that a film shows; NaN if unknown."""

    lines: tuple[dict[str, object], ...]
    cases: Array
    """Case of each episode, (N,)."""
    landings_m: Array
    """Landing points, (N, 2), m."""
    errors_mm: Array
    """Landing errors of the balls that the racket hit, (N,)."""

    def before(self, count: int) -> tuple[float, float]:
        """Share returned and mean error in mm of the last `WINDOW` among the first `count` balls."""
        part = slice(max(0, count - WINDOW), count)
        known = self.errors_mm[part][np.isfinite(self.errors_mm[part])]
        share = float((self.cases[part] == Case.RETURNED).mean()) if count else math.nan
        return share, float(known.mean()) if len(known) else math.nan

    def spots(self, count: int) -> tuple[LandingSpot, ...]:
        """Landing points of the newest among the first `count` balls."""
        known = np.flatnonzero(
            np.isfinite(self.landings_m[:count]).all(axis=1)
            & (np.abs(np.nan_to_num(self.landings_m[:count])).max(axis=1, initial=0.0) < REACH_M)
        )[-SPOTS:]
        return tuple(
            LandingSpot(float(self.landings_m[k, 0]), float(self.landings_m[k, 1]), Case(int(self.cases[k])))
            for k in known
            if self.cases[k] in set(Case)
        )


def shown_balls(count: int) -> tuple[int, ...]:
    """Which of `count` balls are shown, counted from 0: every tenth from the first on, and the last."""
    step = EVERY * max(1, math.ceil(count / EVERY / MAX_BALLS))
    return tuple(sorted({*range(0, count, step), count - 1})) if count else ()


def read_filmed_balls(run: Path, seed: int) -> FilmedBalls:
    """Read the episodes that a seed has played so far.

    Raises:
        CommandError: if that is nothing.
        ConfigError: if a line is broken.
    """
    lines, _ = read_lines(seed_files(run, seed).metrics)
    if not lines:
        raise CommandError("no ball to film", where=f"{run.name}, seed {seed}", remedy="train it first")
    landings = [line.get("landing_m") for line in lines]
    return FilmedBalls(
        tuple(lines),
        np.array([number(line.get("case")) for line in lines]),
        np.array([[number(v) for v in p] if isinstance(p, list) and len(p) == 2 else [np.nan] * 2 for p in landings]),
        np.array([number(line.get("error_mm")) for line in lines]),
    )


def export_training_film(task: RunTask) -> tuple[Path, ...]:
    """Write the film of a seed (the run's first by default) as far as it is trained: H.264, 25 frames a second.

    Raises:
        ConfigError: if there is no such run, or its lines are broken.
        CommandError: if it has played no ball.
    """
    require_package("av", "a film")
    from app.export.film_file import film_file  # the encoder is loaded only for a film

    run, seed = task.run, task.order.seed
    config = read_run(run)
    seed = config.first_seed if seed is None else seed
    balls = read_filmed_balls(run, seed)
    view = standpoint("Broadcast", SIZE.width_px / SIZE.height_px)
    plane_x_m = config.environment.task.stroke.hit_plane_x_m
    drawing = SceneDrawing(SIZE, view, plane_x_m=plane_x_m)
    chart = draw_chart(balls)
    shown = shown_balls(len(balls.lines))
    title = f"{run.name}, {config.agent}" + (f", seed {seed}" if config.seeds > 1 else "")
    written = 0
    with film_file(
        task.path,
        width_px=SIZE.width_px,
        height_px=SIZE.height_px,
        frames_per_s=FRAMES_PER_S,
        overwrite=task.order.overwrite,
    ) as film:
        for number, index in enumerate(shown):
            check_cancelled(task.cancelled)
            ball = ball_of_line(balls.lines[index])
            if ball is None:  # an incomplete line
                continue
            replay = replay_ball(ball, config.environment, None, "")
            for share, image in _frames(drawing, replay, balls, index):
                check_cancelled(task.cancelled)
                _write_words(image, title, balls, index, replay, is_down=share >= _down_share(replay))
                _put_chart(image, chart, (index + 1) / len(balls.lines))
                film.write(image)
                written += 1
                task.progress((number + share) / len(shown))
        if not written:
            raise CommandError("no ball that can be filmed", where=f"{run.name}, seed {seed}")
    task.progress(1.0)
    return (task.path,)


def _frames(drawing: SceneDrawing, replay: Replay, balls: FilmedBalls, index: int) -> Iterator[tuple[float, Image]]:
    """Yield the share of the ball's time so far and its picture (height, width, 3)."""
    spots = balls.spots(index)
    count = max(1, math.ceil(replay.duration_s * FRAMES_PER_S))
    for frame in range(count):
        share = frame / count
        yield share, drawing.draw(replay.picture(share * replay.duration_s, spots))


def _down_share(replay: Replay) -> float:
    return 1.0 - AFTER_LANDING_S / replay.duration_s


def _write_words(image: Image, title: str, balls: FilmedBalls, index: int, replay: Replay, *, is_down: bool) -> None:
    """Write the ball's number, its outcome once it is seen, and the results of the balls before it."""
    ball = replay.ball
    corner = image[: WORDS_PX[1], : WORDS_PX[0]]
    corner[:] = corner // 2
    how = "random action" if ball.is_random else f"noise {ball.noise:.2f}"
    _write(image, f"ball {index + 1} of {len(balls.lines)}", (MARGIN_PX, 48), TEXT_RGB, 1.1)
    _write(image, f"{ball.speed_mps:g} m/s, {how}", (MARGIN_PX, 80), MUTED_RGB, 0.65)
    if is_down and balls.cases[index] in set(Case):
        case, error_mm = Case(int(balls.cases[index])), balls.errors_mm[index]
        error = f", {error_mm:.0f} mm from the target" if math.isfinite(error_mm) else ""
        _write(image, f"{CASE_NAMES[case]}{error}", (MARGIN_PX, 114), CASE_RGB[case], 0.8)
    share, error_mm = balls.before(index + is_down)
    if math.isfinite(share):
        error = f", {error_mm:.0f} mm" if math.isfinite(error_mm) else ""
        text = f"last {min(WINDOW, index + is_down)} balls: {100 * share:.0f} % returned{error}"
        _write(image, text, (MARGIN_PX, 146), TEXT_RGB, 0.65)
    _write(image, title, (MARGIN_PX, SIZE.height_px - MARGIN_PX), MUTED_RGB, 0.55)


def draw_chart(balls: FilmedBalls) -> Image:
    """(height, width, 3) landing error and share returned over the whole training, each of the last `WINDOW` balls."""
    width, height = CHART_PX
    image = np.full((height, width, 3), PANEL_RGB, np.uint8)
    count = len(balls.lines)
    at = np.unique(np.linspace(1, count, min(count, width)).round().astype(int))
    values = np.array([balls.before(int(k)) for k in at])
    x = (width - 1) * at / count
    for column, top, rgb in ((0, 1.0, RETURNED_RGB), (1, CHART_TOP_MM, ERROR_RGB)):
        known = np.isfinite(values[:, column])
        y = (height - 8) - (height - 34) * np.minimum(values[known, column] / top, 1.0)
        points = np.column_stack([x[known], y]).round().astype(np.int32)
        if len(points) > 1:
            cv2.polylines(image, [points], False, rgb, 2, cv2.LINE_AA)
    _write(image, f"returned, of the last {WINDOW}", (8, 16), RETURNED_RGB, 0.45)
    _write(image, f"landing error, 0 to {CHART_TOP_MM:.0f} mm", (width // 2, 16), ERROR_RGB, 0.45)
    return image


def _put_chart(image: Image, chart: Image, share: float) -> None:
    """Put the chart into the lower right corner: bright up to this ball, dark after it."""
    height, width = chart.shape[:2]
    top, left = SIZE.height_px - MARGIN_PX - height, SIZE.width_px - MARGIN_PX - width
    now = round(share * (width - 1))
    shown = chart.copy()
    shown[24:, now + 1 :] = (0.3 * chart[24:, now + 1 :] + 0.7 * np.array(PANEL_RGB)).astype(np.uint8)
    cv2.line(shown, (now, 24), (now, height - 1), TEXT_RGB, 1)
    image[top : top + height, left : left + width] = shown


def _write(image: Image, text: str, at: tuple[int, int], rgb: tuple[int, int, int], size: float) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, rgb, 2 if size > 0.7 else 1, cv2.LINE_AA)
