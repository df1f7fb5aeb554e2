import numpy as np
import pytest

from app.modes.label.labelling import Grid, window_around


def test_the_label_is_in_the_middle_of_its_window() -> None:
    assert window_around(10_000, 2_000) == (9_000, 11_000)
    assert window_around(10_000, 501) == (9_750, 10_251)
    assert window_around(0, 2_000) == (0, 1_000)


@pytest.mark.parametrize(
    ("t_us", "steps", "there"),
    [(4000, 1, 6000), (4000, -1, 2000), (4001, 1, 6000), (4001, -1, 4000), (0, -1, 0), (9000, 5, 8000), (0, 3, 6000)],
)
def test_steps_lead_along_the_grid(t_us: int, steps: int, there: int) -> None:
    assert Grid(9_999, 2_000).moved(t_us, steps) == there


def test_the_grid_ends_inside_the_recording() -> None:
    assert Grid(10_000, 2_000).times().tolist() == [0, 2000, 4000, 6000, 8000]
    assert Grid(10_001, 2_000).last_us == 10_000


def test_frames_are_stepped_through_at_their_own_times() -> None:
    grid = Grid(10_000, 2_000, np.array([100, 900, 4000]))
    assert [grid.moved(t, +1) for t in (0, 100, 500, 4000)] == [100, 900, 900, 4000]
    assert [grid.moved(t, -1) for t in (4000, 4001, 100, 0)] == [900, 4000, 100, 100]
    assert grid.moved(0, 10) == 4000 and grid.last_us == 4000 and grid.times().tolist() == [100, 900, 4000]
