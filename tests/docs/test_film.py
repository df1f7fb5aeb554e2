"""The film of the README, and the command that makes it."""

import io
import itertools
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from app.shared.workspace import Workspace
from core.errors import CommandError
from core.history.recorded_rally import RACKET, TARGETS
from core.recordings import open_recording
from docs import make_film
from tests.ensure_chromium import find_chromium

ROOT = Path(__file__).parents[2]


def lengths_ms(film: Image.Image) -> list[int]:
    """How long each picture stands; it is known once the picture has been read."""
    lengths = []
    for frame in ImageSequence.Iterator(film):
        frame.load()
        lengths.append(frame.info["duration"])
    return lengths


def test_the_film_of_the_readme_is_ten_seconds_of_something_that_moves() -> None:
    path = ROOT / make_film.OUT
    assert path.name in (ROOT / "README.md").read_text(encoding="utf-8")
    assert path.stat().st_size <= make_film.LARGEST_BYTES <= 5_000_000
    with Image.open(path) as film:
        assert sum(lengths_ms(film)) == pytest.approx(10_000, abs=200)
        pictures = []
        for number in range(0, film.n_frames, film.n_frames // 10):
            film.seek(number)
            pictures.append(np.asarray(film.convert("RGB"), np.int16))
    changes = [np.count_nonzero(np.abs(b - a).max(axis=-1) > 60) for a, b in itertools.pairwise(pictures)]
    assert min(changes) > 100


def test_moments_are_even_and_as_many_as_the_film_needs() -> None:
    plan = make_film.FilmPlan(seconds=10, frames_hz=12.5)
    moments = plan.moments_us(40_000, 2_540_000)
    assert plan.frame_ms == 80 and len(moments) == 125
    assert moments[0] == 40_000 and moments[-1] == 2_520_000
    assert set(np.diff(moments)) == {20_000}


def test_a_film_keeps_its_pictures_and_their_time() -> None:
    colours = [(250, 20, 20), (20, 250, 20), (20, 20, 250)]
    data = make_film.webp_of([Image.new("RGB", (64, 48), colour) for colour in colours], 80)
    with Image.open(io.BytesIO(data)) as film:
        assert lengths_ms(film) == [80, 80, 80] and film.info["loop"] == 0
        for number, colour in enumerate(colours):
            film.seek(number)
            assert np.abs(np.asarray(film.convert("RGB"), int)[24, 32] - colour).max() < 25


@pytest.fixture(scope="module")
def rally(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    workspace = Workspace(tmp_path_factory.mktemp("film"))
    assert make_film.play_rally(workspace.recording_path("rally"), (5.0,), make_film.SEED) == ["returned"]
    return workspace


def test_the_rally_is_played_by_what_is_seen(rally: Workspace) -> None:
    with open_recording(rally.recording_path("rally")) as recording:
        assert set(recording.cameras) == {"left", "right"}
        racket, targets = recording.read_rows(RACKET), recording.read_rows(TARGETS)
        assert racket is not None and targets is not None
        assert {bytes(stage) for stage in targets["stage"]} == {b"pre", b"post"}
        assert min(targets["t_us"]) > 0
        assert np.ptp(racket["p_world_m"], axis=0).max() > 0.05


@pytest.mark.browser
def test_pictures_show_the_rally_in_the_app(rally: Workspace) -> None:
    if find_chromium() is None:
        pytest.skip("no Chromium here; see tests/ensure_chromium.py")
    shares: list[float] = []
    with ThreadPoolExecutor(1) as pool:  # Playwright allows one at a time in a thread, and other tests have theirs
        plan = make_film.FilmPlan(0.2, 10)
        first, second = pool.submit(make_film.film_recording, rally, "rally", plan, shares.append).result()
    assert first.size == second.size == (876, 720) and shares == [0.5, 1.0]
    changed = np.abs(np.asarray(first, np.int16) - np.asarray(second, np.int16)).max(axis=-1) > 60
    assert np.count_nonzero(changed[:640, 284:]) > 100, "the scene"
    assert np.count_nonzero(changed[640:, 284:]) > 20, "the time bar"


def test_without_a_browser_it_says_how_to_get_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RALLYSCOPE_CHROMIUM", str(tmp_path / "none"))
    with pytest.raises(CommandError, match="no browser to film in"):
        make_film.film_recording(Workspace(tmp_path), "rally", make_film.FilmPlan(), lambda share: None)
