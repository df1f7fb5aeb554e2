"""A film of a whole training: which balls, in which order, and what is written on them."""

import dataclasses
import itertools
import shutil
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest

from app.export.scenes.training_film import (
    CHART_PX,
    ERROR_RGB,
    EVERY,
    FRAMES_PER_S,
    MARGIN_PX,
    MAX_BALLS,
    SIZE,
    FilmedBalls,
    draw_chart,
    export_training_film,
    read_filmed_balls,
    shown_balls,
)
from app.export.unfinished import ExportCancelledError
from app.modes.train.form import startable_run
from app.shared.training_records import ball_of_line, replay_ball
from core.errors import CommandError, ConfigError
from core.learning.config import default_run
from core.learning.runs.run_files import create_run, read_run, seed_files
from core.learning.runs.running import run_training
from core.physics.episode import Case
from tests.app.export.tasks import run_task
from tests.waiting import PATIENCE_S


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """24 balls of two seeds. Do not write to it."""
    folder = tmp_path_factory.mktemp("runs") / "small"
    config = default_run("landing-model")
    curriculum = dataclasses.replace(config.curriculum, speeds_mps=(5.0,), episodes=(24,))
    create_run(folder, startable_run(dataclasses.replace(config, curriculum=curriculum, seeds=2)))
    assert run_training(folder) == "finished"
    return folder


def test_every_tenth_ball_is_shown_from_the_first_to_the_last() -> None:
    assert shown_balls(0) == () and shown_balls(1) == (0,)
    assert shown_balls(24) == (0, 10, 20, 23) and shown_balls(21) == (0, 10, 20)
    assert len(shown_balls(10 * MAX_BALLS)) == MAX_BALLS + 1  # and the last
    long = shown_balls(1_000_000)
    assert len(long) <= MAX_BALLS + 1 and long[0] == 0 and long[-1] == 999_999
    assert set(np.diff(long[:-1]) % EVERY) == {0}


def test_figures_are_of_the_balls_so_far_and_never_of_later_ones(run: Path) -> None:
    balls = read_filmed_balls(run, 0)
    assert len(balls.lines) == 24 and np.isnan(balls.before(0)).all()
    share, error_mm = balls.before(7)
    assert share == np.mean(balls.cases[:7] == Case.RETURNED)
    assert error_mm == pytest.approx(np.nanmean(balls.errors_mm[:7]))
    later = FilmedBalls(balls.lines, balls.cases.copy(), balls.landings_m, balls.errors_mm.copy())
    later.cases[7:], later.errors_mm[7:] = Case.MISSED, 9e3
    assert later.before(7) == (share, error_mm) and later.before(8) != balls.before(8)
    assert len(balls.spots(7)) <= 7 and {spot.case for spot in balls.spots(24)} <= set(Case)


def test_the_film_holds_each_ball_for_as_long_as_it_flew(run: Path, tmp_path: Path) -> None:
    shares: list[float] = []
    (path,) = export_training_film(run_task(run, tmp_path / "a.mp4", seed=1, progress=shares.append))
    environment = read_run(run).environment
    frames = 0
    for index in shown_balls(24):
        ball = ball_of_line(read_filmed_balls(run, 1).lines[index])
        assert ball is not None
        frames += max(1, int(np.ceil(replay_ball(ball, environment, None, "").duration_s * FRAMES_PER_S)))
    with av.open(str(path)) as film:
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(film.streams.video[0])]
    assert len(pictures) == frames and pictures[0].shape == (SIZE.height_px, SIZE.width_px, 3)
    assert shares == sorted(shares) and shares[-1] == 1.0
    # The cursor of the chart goes from the first ball to the last, and what is to come is dark.
    top = SIZE.height_px - MARGIN_PX - CHART_PX[1] + 40
    chart = slice(SIZE.width_px - MARGIN_PX - CHART_PX[0], SIZE.width_px - MARGIN_PX)
    cursors = [picture[top : top + 60, chart].min(axis=2).mean(axis=0).argmax() for picture in pictures]
    assert cursors[0] < 0.1 * CHART_PX[0] and cursors[-1] > 0.95 * CHART_PX[0]
    assert all(later >= earlier - 2 for earlier, later in itertools.pairwise(cursors))
    words = (slice(20, 60), slice(MARGIN_PX, 400))  # "ball 1 of 24", "ball 24 of 24"
    assert np.abs(pictures[0][words].astype(int) - pictures[-1][words]).max() > 100


def test_the_chart_draws_the_errors(run: Path) -> None:
    balls = read_filmed_balls(run, 0)
    good = FilmedBalls(balls.lines, balls.cases, balls.landings_m, np.full(24, 80.0))
    rows = np.flatnonzero((draw_chart(good)[30:] == ERROR_RGB).all(axis=2).any(axis=1)) + 30
    expected = CHART_PX[1] - 8 - (CHART_PX[1] - 34) * 80 / 800
    assert len(rows) and abs(rows.mean() - expected) < 2


def test_a_cancelled_film_leaves_nothing(run: Path, tmp_path: Path) -> None:
    asked = iter(range(1000))
    with pytest.raises(ExportCancelledError):
        export_training_film(run_task(run, tmp_path / "a.mp4", cancelled=lambda: next(asked) > 12))
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_filmed_is_said(run: Path, tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="no ball to film"):
        export_training_film(run_task(run, tmp_path / "a.mp4", seed=7))
    with pytest.raises(ConfigError, match="not a training run"):
        export_training_film(run_task(tmp_path, tmp_path / "a.mp4"))
    damaged = tmp_path / "damaged"
    shutil.copytree(run, damaged)
    seed_files(damaged, 0).metrics.write_text('{"episode": 0}\n' * 3)
    with pytest.raises(CommandError, match="no ball that can be filmed"):
        export_training_film(run_task(damaged, tmp_path / "a.mp4"))
    assert not (tmp_path / "a.mp4").exists()


@pytest.mark.gate
def test_the_command_line_makes_it_too(run: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "app.cli", "export", str(run), "--mp4", str(tmp_path / "b.mp4"), "--seed", "1"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    with av.open(str(tmp_path / "b.mp4")) as film:
        assert film.streams.video[0].frames > 60
