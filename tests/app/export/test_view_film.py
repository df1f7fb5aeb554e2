"""A film of pictures that are drawn one by one."""

from pathlib import Path

import av
import numpy as np
import pytest

from app.export.film_file import film_file
from app.export.selection import Span
from app.export.unfinished import ExportCancelledError
from app.export.view_film import MAX_FRAMES, ViewFilmPlan, export_view_film
from core.errors import CommandError


def plan(**changes) -> ViewFilmPlan:
    fields = {"span": Span(100_000, 200_000), "width_px": 320, "height_px": 180, **changes}
    return ViewFilmPlan(**fields)


def grey(t_us: int) -> np.ndarray:
    """A picture that says its time."""
    return np.full((180, 320, 3), (t_us - 100_000) // 1_000 * 2, np.uint8)


def read(path: Path) -> tuple[list[np.ndarray], list[float], float]:
    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        frames = list(film.decode(stream))
        return [one.to_ndarray(format="rgb24") for one in frames], [one.time for one in frames], stream.average_rate


def test_frames_stand_in_recording_time_and_play_at_the_chosen_speed(tmp_path: Path) -> None:
    asked: list[int] = []
    shares: list[float] = []

    def picture_at(t_us: int) -> np.ndarray:
        asked.append(t_us)
        return grey(t_us)

    export_view_film(tmp_path / "a.mp4", plan(speed=0.25, frames_per_s=25.0), picture_at, progress=shares.append)
    assert asked == list(range(100_000, 200_000, 10_000)) and shares[-1] == 1.0
    frames, times, rate = read(tmp_path / "a.mp4")
    assert float(rate) == 25 and len(frames) == 10
    assert times == pytest.approx([0.04 * number for number in range(10)])
    assert [round(float(frame.mean())) for frame in frames] == pytest.approx([20 * n for n in range(10)], abs=4)


@pytest.mark.parametrize(("speed", "fps", "count"), [(1.0, 25.0, 2), (0.5, 60.0, 12), (1 / 16, 50.0, 80)])
def test_slower_films_have_more_frames(speed: float, fps: float, count: int) -> None:
    times = plan(speed=speed, frames_per_s=fps).times_us()
    assert len(times) == count and times[0] == 100_000 and times[-1] < 200_000


def test_a_film_that_is_too_long_is_refused_before_it_begins() -> None:
    with pytest.raises(CommandError, match=f"up to {MAX_FRAMES} frames"):
        plan(span=Span(0, 600_000_000), speed=0.1).times_us()


def test_nothing_is_left_of_a_film_that_is_cancelled_or_whose_browser_is_gone(tmp_path: Path) -> None:
    def gone(t_us: int) -> np.ndarray:
        if t_us > 150_000:
            raise CommandError("the browser that draws the film is gone")
        return grey(t_us)

    with pytest.raises(CommandError, match="is gone"):
        export_view_film(tmp_path / "a.mp4", plan(), gone)
    answers = iter([False] * 4 + [True])
    with pytest.raises(ExportCancelledError):
        export_view_film(tmp_path / "a.mp4", plan(), grey, cancelled=lambda: next(answers))
    with pytest.raises(CommandError, match="another size"):
        export_view_film(tmp_path / "a.mp4", plan(width_px=640), grey)
    assert list(tmp_path.iterdir()) == []


def test_colours_survive_and_odd_sizes_are_refused(tmp_path: Path) -> None:
    orange = np.zeros((180, 320, 3), np.uint8) + np.array((255, 140, 40), np.uint8)
    with film_file(tmp_path / "a.mp4", width_px=320, height_px=180, frames_per_s=30.0) as film:
        film.write(orange)
    ((frame,), _, _) = read(tmp_path / "a.mp4")
    assert np.abs(frame[20:-20, 20:-20].astype(int) - (255, 140, 40)).max() < 16
    with (
        pytest.raises(CommandError, match="even numbers"),
        film_file(tmp_path / "b.mp4", width_px=321, height_px=180, frames_per_s=30.0),
    ):
        pass
