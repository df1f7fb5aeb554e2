"""Selected balls become launches that a training draws: each once, and none whose state is not known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from core.errors import CommandError
from core.physics.ball_states import read_ball_states
from labels.balls.launches import FEWEST, WrittenLaunches, write_launches
from labels.balls.rows import BallRow
from labels.balls.table import joined, table_of


def state(number: int) -> tuple[float, ...]:
    return (1.2, 0.1, 0.3 + 0.01 * number, -5.0, 0.2, 1.0, 4.0, -30.0, -7.0)


def rows(count: int) -> list[BallRow]:
    """Of each ball a stroke, the flight that it begins, and a bounce."""
    kinds = ("stroke", "flight", "bounce")
    return [
        BallRow(kind=kind, number=number, t_us=number * 1000, method="truth", state=state(number))
        for number in range(count)
        for kind in kinds
    ]


def table(rows: list[BallRow]):
    return joined([("recording", "one", table_of(rows), np.zeros(len(rows)))])


def test_each_flight_is_written_once_and_says_where_it_is_from(tmp_path: Path) -> None:
    unknown = BallRow(kind="flight", number=99, t_us=5, method="prediction")
    path = tmp_path / "balls.json"
    assert write_launches(path, table([*rows(FEWEST), unknown])) == WrittenLaunches(FEWEST, 1)
    np.testing.assert_allclose(read_ball_states(path).states(), [state(number) for number in range(FEWEST)])
    assert json.loads(path.read_text())[2] | {"t_us": 2000, "name": "one"} == json.loads(path.read_text())[2]


def test_too_few_are_refused_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="too few balls"):
        write_launches(tmp_path / "balls.json", table(rows(FEWEST - 1)))
    assert not (tmp_path / "balls.json").exists()
