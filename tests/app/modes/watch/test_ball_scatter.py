"""The points of the balls: each at its place, found by a click and by a line drawn round it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from app.modes.watch.ball_scatter import (
    AXES,
    HEIGHT_PX,
    WIDTH_PX,
    BallScatter,
    ScatterAxes,
    draw_scatter,
    row_at,
    rows_within,
)
from labels.balls.rows import BallRow
from labels.balls.table import COLUMNS, joined, table_of

AXES_OF_ALL = ScatterAxes("speed_mps", "spin_radps", "outcome")
OUTCOMES = ("net", "out", "")


def table(count: int = 30, names: tuple[str, ...] = ("one", "two")):
    rng = np.random.default_rng(0)
    rows = [
        BallRow(
            kind="flight", number=n, t_us=n, speed_mps=rng.uniform(3, 9), spin_radps=rng.uniform(0, 99),
            outcome=OUTCOMES[n % 3], method="truth",
        )
        for n in range(count)
    ]  # fmt: skip
    return joined([("recording", name, table_of(rows), np.zeros(count)) for name in names])


def place(scatter: BallScatter, row: int) -> tuple[float, float]:
    x, y = scatter.places_px[scatter.rows.tolist().index(row)]
    return float(x) / WIDTH_PX, float(y) / HEIGHT_PX


def picture(scatter: BallScatter) -> np.ndarray:
    found = cv2.imdecode(np.frombuffer(scatter.png, np.uint8), cv2.IMREAD_COLOR)
    assert found is not None and found.shape == (HEIGHT_PX, WIDTH_PX, 3)
    return found


def test_every_column_can_be_drawn_by_every_axis_and_each_point_is_in_the_picture() -> None:
    assert set(AXES.values()) <= set(COLUMNS)
    for column in AXES.values():
        for axes in (ScatterAxes(x=column), ScatterAxes(y=column), ScatterAxes(colour=column)):
            scatter = draw_scatter(table(), np.arange(60), axes)
            picture(scatter)
            assert ((scatter.places_px >= 0) & (scatter.places_px < (WIDTH_PX, HEIGHT_PX))).all()


def test_more_is_farther_right_and_farther_up() -> None:
    scatter = draw_scatter(table(names=("one",)), np.arange(30), AXES_OF_ALL)
    speeds, spins = (np.array(table(names=("one",)).column(name)) for name in ("speed_mps", "spin_radps"))
    assert np.corrcoef(scatter.places_px[:, 0], speeds)[0, 1] > 0.9999
    assert np.corrcoef(scatter.places_px[:, 1], spins)[0, 1] < -0.9999


def test_a_click_on_any_point_finds_its_row_and_one_beside_all_none() -> None:
    scatter = draw_scatter(table(names=("one",)), np.arange(3, 30), AXES_OF_ALL)
    assert [row_at(scatter, *place(scatter, row)) for row in range(3, 30)] == list(range(3, 30))
    assert row_at(scatter, 0.001, 0.999) is None
    assert row_at(draw_scatter(table(), np.zeros(0, np.int64), ScatterAxes()), 0.5, 0.5) is None


def test_a_line_round_one_point_selects_it_alone() -> None:
    scatter = draw_scatter(table(5, ("one",)), np.arange(5), AXES_OF_ALL)
    x, y = place(scatter, 2)
    square = [(x + dx, y + dy) for dx, dy in ((-0.01, -0.01), (0.01, -0.01), (0.01, 0.01), (-0.01, 0.01))]
    assert rows_within(scatter, square).tolist() == [2]
    assert rows_within(scatter, [(0, 0), (1, 0), (1, 1), (0, 1)]).tolist() == list(range(5))
    assert not len(rows_within(scatter, [(0, 0)]))


def test_what_is_not_selected_is_pale() -> None:
    whole, part = (draw_scatter(table(5, ("one",)), np.arange(5), AXES_OF_ALL, one) for one in (None, np.array([2])))
    for row, (x, y) in enumerate(whole.places_px):
        before, now = picture(whole)[y, x], picture(part)[y, x]
        assert (before == now).all() if row == 2 else now.max() < before.max()


@pytest.mark.parametrize("count", [1, 40])
def test_of_many_texts_some_are_named_and_a_name_from_a_file_is_text(count: int) -> None:
    names = tuple(f"<b>{n}" for n in range(count))
    legend = draw_scatter(table(2, names), np.arange(2 * count), ScatterAxes("name", "spin_radps", "name")).legend
    assert "<b>" not in legend and ("28 others" in legend) == (count == 40)
