"""The newest hit point by the time that is left."""

import numpy as np
import pytest

from benchmarks.rally.hit_point import LEADS_MS, hit_cells, hit_point_rows, newest_hit_errors_mm
from core.physics import PhysicsConfig
from core.physics.flight import air_from_config
from core.recordings import BallTruth

T_US = np.arange(0, 1_000_001, 1000)
V = np.array([-4.0, 0.0, 0.0])
CROSSES_US = 705_000
NO_AIR = air_from_config(PhysicsConfig())


def truth() -> BallTruth:
    """A ball that comes through x = -1.42 m after 705 ms, at y 0.2 and z 0.3."""
    p = np.array([1.4, 0.2, 0.3]) + np.outer(T_US * 1e-6, V)
    return BallTruth(T_US, p, np.tile(V, (len(T_US), 1)), np.zeros_like(p), np.ones(len(T_US), np.bool_))


def told(y_m: float, x_m: float = -1.42) -> np.ndarray:
    return np.array([x_m, y_m, 0.3])


def test_the_newest_hit_point_counts_however_old_it_is() -> None:
    points = [(CROSSES_US - 250_000, told(0.25)), (CROSSES_US - 60_000, told(0.21)), (CROSSES_US - 10_000, told(0.2))]
    errors = dict(zip(LEADS_MS, newest_hit_errors_mm(points, truth(), NO_AIR), strict=True))
    assert errors[400] is None and errors[300] is None, "nothing was known by then"
    assert errors[200] == errors[100] == pytest.approx(50) and errors[50] == errors[25] == pytest.approx(10)


def test_a_ball_that_never_comes_and_one_that_nothing_was_told_of_have_no_error() -> None:
    late = [(CROSSES_US - 250_000, told(0.25))]
    away = BallTruth(
        *(getattr(truth(), name)[:300] for name in ("t_us", "p_world_m", "v_world_mps", "spin_radps", "visible"))
    )
    assert (
        newest_hit_errors_mm(late, away, NO_AIR) == newest_hit_errors_mm([], truth(), NO_AIR) == [None] * len(LEADS_MS)
    )


def test_a_point_counts_at_its_own_x_also_where_the_ball_was_struck_before_it_came_so_far() -> None:
    whole = truth()
    back = whole.t_us > 600_000  # struck at x = -1 m, 42 cm before the plane
    v = np.where(back[:, None], -whole.v_world_mps, whole.v_world_mps)
    struck = BallTruth(whole.t_us, whole.p_world_m, v, whole.spin_radps, whole.visible)
    fallen_m = 9.81 / 2 * 0.105**2
    low = told(0.23) - [0, 0, fallen_m]  # where it would have come through the plane, but for 30 mm
    points = [(600_000 - 250_000, told(0.25, -0.6)), (600_000 - 120_000, low), (600_000 - 60_000, told(0.21, -1.0))]
    errors = dict(zip(LEADS_MS, newest_hit_errors_mm(points, struck, NO_AIR), strict=True))
    assert errors[300] is None and errors[200] == errors[150] == pytest.approx(50)
    assert errors[100] == pytest.approx(30, abs=0.5) and errors[50] == errors[25] == pytest.approx(10)


def test_rows_count_the_balls_that_have_one_and_cells_are_a_row_a_speed() -> None:
    nothing, two = [None] * len(LEADS_MS), [10.0] * len(LEADS_MS)
    rows = hit_point_rows([two, nothing, [30.0] * len(LEADS_MS)])
    assert rows[0] == {"lead_ms": 400, "told": 2, "median_mm": 20.0, "p95_mm": pytest.approx(29)}
    assert hit_point_rows([nothing])[0]["median_mm"] is None
    cells = hit_cells([{"speed_mps": speed} | one for speed in (3.0, 5.0) for one in rows])
    assert [row[0] for row in cells] == ["3", "5"] and cells[0][1] == "20 (2)" and len(cells[0]) == 1 + len(LEADS_MS)
