"""The pictures of the steps in a lab: each is made by the one command, is there, is shown, and shows something."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from core.cameras.calibration.coverage import cells_of
from core.recordings import open_recording
from docs.lab_events import write_noise
from docs.lab_pictures import STEPS
from docs.make_images import OUT

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / OUT / "your-lab"
LARGEST_BYTES = 100_000


def test_every_step_has_its_picture_and_no_other_is_there() -> None:
    assert {path.stem for path in FOLDER.iterdir()} == set(STEPS)


@pytest.mark.parametrize("name", STEPS)
def test_a_picture_is_small_shown_and_not_empty(name: str) -> None:
    path = FOLDER / f"{name}.png"
    assert path.stat().st_size <= LARGEST_BYTES
    assert f"images/your-lab/{name}.png" in (ROOT / "docs/use/your-lab.md").read_text(encoding="utf-8")
    with Image.open(path) as image:
        grey = np.asarray(image.convert("L"), np.int16)
    assert (np.abs(grey - np.median(grey)) > 40).mean() > 0.005


def test_the_still_cameras_see_noise_alone(tmp_path: Path) -> None:
    write_noise(tmp_path / "still.h5", 20_000)
    with open_recording(tmp_path / "still.h5") as recording:
        assert recording.duration_us <= 20_000
        for stream in recording.cameras.values():
            seen = stream.slice(0, 20_000)
            assert 500 < len(seen) < 5000
            cells = np.bincount(cells_of(np.column_stack([seen.x_px, seen.y_px]), stream.sensor), minlength=48)
            assert len(cells) == 48 and cells.min() > 0 and cells.max() < 4 * cells.mean()  # with a hot pixel
