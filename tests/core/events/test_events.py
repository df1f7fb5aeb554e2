import itertools

import numpy as np
import pytest

from core.errors import EventsError
from core.events import Events, SensorSize, Window, concatenate_events

SENSOR = SensorSize(20, 10)


def some_events(count: int = 50, seed: int = 0) -> Events:
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, 1000, count))
    return Events.from_columns(
        t, rng.integers(0, 20, count), rng.integers(0, 10, count), rng.random(count) < 0.5, SENSOR
    )


def test_columns_have_their_types_and_cannot_be_written_to() -> None:
    events = some_events()
    for column, kind in (
        (events.t_us, np.int64),
        (events.x_px, np.uint16),
        (events.y_px, np.uint16),
        (events.on, bool),
    ):
        assert column.dtype == kind and column.flags.c_contiguous
        with pytest.raises(ValueError, match="read-only"):
            column[0] = 0


def test_the_arrays_of_the_caller_stay_writeable_and_unchanged() -> None:
    t = np.array([1, 2], np.int64)
    x = np.array([3, 4], np.uint16)
    Events.from_columns(t, x, x, [True, False], SENSOR)
    t[0] = 0
    assert t.flags.writeable and x.tolist() == [3, 4]


def test_parts_of_read_only_events_are_read_only() -> None:
    events = some_events()
    for part in (events.between(100, 500), events.rows(events.on), events.rows(np.array([1, 3]))):
        assert not part.t_us.flags.writeable and not part.on.flags.writeable


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (([2, 1], [0, 0], [0, 0], [0, 0]), "time runs backwards at event 1"),
        (([1, 2], [0, 20], [0, 0], [0, 0]), "x outside the 20x10 sensor"),
        (([1, 2], [0, 0], [-1, 0], [0, 0]), "y outside the 20x10 sensor"),
        (([1, 2], [0], [0, 0], [0, 0]), "event columns differ in shape"),
    ],
)
def test_columns_that_are_no_stream_are_refused(columns: tuple, message: str) -> None:
    with pytest.raises(EventsError, match=message):
        Events.from_columns(*columns, SENSOR)


def test_between_is_half_open_and_its_parts_make_the_whole() -> None:
    events = Events.from_columns([0, 10, 10, 20], [1, 2, 3, 4], [0] * 4, [1, 0, 1, 0], SENSOR)
    assert events.between(10, 20).x_px.tolist() == [2, 3]
    assert len(events.between(21, 5)) == 0
    many = some_events(500)
    cuts = [-10, 0, 3, 400, 401, 999, 2000]
    whole = concatenate_events([many.between(a, b) for a, b in itertools.pairwise(cuts)], SENSOR)
    assert np.array_equal(whole.t_us, many.t_us) and np.array_equal(whole.x_px, many.x_px)


def test_nothing_is_a_legal_stream() -> None:
    nothing = Events.empty(SENSOR)
    assert len(nothing) == 0 and len(nothing.between(0, 10)) == 0 and len(nothing.rows(nothing.on)) == 0
    assert len(concatenate_events([], SENSOR)) == 0
    assert len(Window(nothing, 0, 10).events) == 0


def test_parts_out_of_order_are_refused() -> None:
    late, early = some_events().between(500, 1000), some_events().between(0, 500)
    with pytest.raises(EventsError, match="backwards"):
        concatenate_events([late, early], SENSOR)


def test_a_window_holds_only_its_own_events() -> None:
    events = Events.from_columns([5, 9], [0, 0], [0, 0], [0, 1], SENSOR)
    assert Window(events, 5, 10).events is events
    for start, end in ((6, 10), (5, 9), (0, 5)):
        with pytest.raises(EventsError, match="outside their window"):
            Window(events, start, end)
    with pytest.raises(EventsError, match="no length"):
        Window(Events.empty(SENSOR), 10, 10)


@pytest.mark.parametrize("size", [(0, 10), (10, -1), (70000, 10)])
def test_an_impossible_sensor_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(EventsError, match="impossible sensor size"):
        SensorSize(*size)
