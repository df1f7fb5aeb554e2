import numpy as np
import pytest

from core.detection.stages.denoise import DenoiseConfig, survives_opening
from core.events import Events, SensorSize

SENSOR = SensorSize(64, 48)


def events_of(picture: np.ndarray, x: int = 0, y: int = 0) -> Events:
    rows, columns = np.nonzero(picture)
    count = len(rows)
    return Events.from_columns(np.zeros(count), columns + x, rows + y, np.ones(count), SENSOR)


def kept_picture(picture: np.ndarray, kernel_px: int = 3, x: int = 0, y: int = 0) -> np.ndarray:
    events = events_of(picture, x, y)
    keep = survives_opening(events, DenoiseConfig(kernel_px=kernel_px))
    result = np.zeros_like(picture)
    result[events.y_px[keep] - y, events.x_px[keep] - x] = 1
    return result


def test_a_cross_survives_and_its_missing_arm_removes_it() -> None:
    cross = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]])
    assert np.array_equal(kept_picture(cross), cross)
    cross[0, 1] = 0
    assert not kept_picture(cross).any()


def test_corners_of_a_full_square_are_lost_because_the_kernel_is_an_ellipse() -> None:
    square = np.ones((4, 4), int)
    expected = square.copy()
    expected[[0, 0, -1, -1], [0, -1, 0, -1]] = 0
    assert np.array_equal(kept_picture(square), expected)


def test_what_lies_outside_the_bounding_rectangle_counts_as_empty() -> None:
    """Two rows, as thick as the picture: without a border of zeros the erosion would take the outside for set."""
    assert not kept_picture(np.ones((2, 12), int)).any()


def test_a_distant_noise_pixel_changes_nothing() -> None:
    picture = np.zeros((40, 60), int)
    picture[0:6, 0:5] = np.random.default_rng(1).random((6, 5)) < 0.85
    alone = kept_picture(picture)
    picture[39, 59] = 1
    assert np.array_equal(kept_picture(picture)[:6, :5], alone[:6, :5]) and not kept_picture(picture)[39, 59]


@pytest.mark.parametrize("corner", [(0, 0), (63 - 7, 0), (0, 47 - 7), (63 - 7, 47 - 7), (20, 13)])
def test_the_answer_does_not_depend_on_the_place_on_the_sensor(corner: tuple[int, int]) -> None:
    picture = (np.random.default_rng(2).random((8, 8)) < 0.8).astype(int)
    assert np.array_equal(kept_picture(picture, 3, *corner), kept_picture(picture))
    assert kept_picture(picture).any()


def test_every_event_of_a_surviving_pixel_is_kept() -> None:
    cross = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]])
    rows, columns = np.nonzero(cross)
    events = Events.from_columns(np.zeros(15), np.tile(columns, 3), np.tile(rows, 3), np.arange(15) % 2, SENSOR)
    assert survives_opening(events, DenoiseConfig()).all()


def test_a_kernel_of_one_pixel_keeps_everything_and_no_events_are_no_trouble() -> None:
    assert kept_picture(np.eye(5, dtype=int), kernel_px=1).sum() == 5
    assert survives_opening(Events.empty(SENSOR), DenoiseConfig()).shape == (0,)
