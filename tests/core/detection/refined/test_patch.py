"""Which pixels become edge points."""

import numpy as np
import pytest

from core.detection.refined.ball_fit import Reach, span_for
from core.detection.refined.circle_fit import EdgePoints
from core.detection.refined.history import Recent
from core.detection.refined.patch import LookBack, MovingCircle, blank_patch, clear_patch, edge_points, fill_patch

pytestmark = pytest.mark.numeric
END_US = 50_000
SPAN = LookBack(END_US, 4.0, 3.0, 0.5)
BALL = MovingCircle(100.0, 60.0, 2.0, 0.0, 8.0)


def recent(*events: tuple[int, int, int, bool]) -> Recent:
    t, x, y, on = zip(*sorted(events), strict=True)
    return Recent(np.array(t, np.int64), np.array(x, np.uint16), np.array(y, np.uint16), np.array(on, np.bool_))


def found(events: Recent, ball: MovingCircle = BALL, span: LookBack = SPAN) -> tuple[list[tuple[float, ...]], int]:
    """The edge points (u, v, ms, events, lead) and the events inside."""
    patch, points = blank_patch(), EdgePoints(*np.zeros((6, 1200)))
    count, x0, y0 = fill_patch(events, patch, ball.u, ball.v, 40, span)
    number, inside = edge_points(patch, count, (x0, y0), ball, 2.5, span, points)
    clear_patch(patch, count)
    assert not patch.first.any() and not patch.last.any(), "it is empty for the next one"
    columns = points[:5]
    return [tuple(float(column[k]) for column in columns) for k in range(number)], inside


def column_at(t_us: int, x: int, on: bool) -> list[tuple[int, int, int, bool]]:
    """Five pixels, one above the other: three have neighbours on both sides."""
    return [(t_us, x, y, on) for y in range(58, 63)]


def test_on_the_leading_edge_the_first_event_counts_and_on_the_trailing_one_the_last() -> None:
    ahead = column_at(END_US - 1000, 106, True) + column_at(END_US - 600, 106, True)
    behind = column_at(END_US - 2000, 90, False) + column_at(END_US - 1000, 90, False)
    points, inside = found(recent(*ahead, *behind))
    assert inside == 0
    assert {(u, ms, lead) for u, _, ms, _, lead in points} == {(106.0, -1.0, 1.0), (90.0, -1.0, 0.0)}
    assert all(events == 2 for *_, events, _ in points) and len(points) == 6


def test_of_a_tail_the_first_event_of_the_trailing_polarity_counts() -> None:
    span = SPAN._replace(tail=True)
    ahead = column_at(END_US - 1000, 106, True)
    tail = column_at(END_US - 2000, 88, False) + column_at(END_US - 200, 88, False)
    passed = column_at(END_US - 3500, 90, True) + column_at(END_US - 1000, 90, False)
    points, _ = found(recent(*ahead, *tail, *passed), span=span)
    assert {(u, ms, lead) for u, _, ms, _, lead in points} == {(106.0, -1.0, 1.0), (88.0, -2.0, 0.0), (90.0, -1.0, 0.0)}
    dark = [(t, x, y, not on) for t, x, y, on in (*ahead, *tail, *passed)]
    assert [point[:3] for point in found(recent(*dark), span=span)[0]] == [point[:3] for point in points]
    old = column_at(END_US - 3500, 88, False) + column_at(END_US - 1000, 88, False)
    assert {u for u, *_ in found(recent(*ahead, *old), span=span)[0]} == {106.0}, "it had begun before the history"


@pytest.mark.parametrize("bright", [True, False], ids=["bright", "dark"])
def test_of_a_known_polarity_the_events_of_the_balls_own_shadow_do_not_count(bright) -> None:
    ahead = column_at(END_US - 2800, 106, not bright) + column_at(END_US - 1000, 106, bright)
    behind = column_at(END_US - 1000, 90, not bright) + column_at(END_US - 700, 90, bright)
    shadow = column_at(END_US - 1000, 107, not bright)
    events = recent(*ahead, *behind, *shadow)
    lead = 1.0 if bright else -1.0
    known = {(106.0, -1.0, lead), (107.0, -1.0, -lead), (90.0, -1.0, 0.0)}
    points, _ = found(events, span=SPAN._replace(polarity=1 if bright else -1))
    assert {(u, ms, lead) for u, _, ms, _, lead in points} == known, "a pixel of the shadow alone stays what it is"
    blind, _ = found(events)
    assert {(u, round(ms, 3)) for u, _, ms, *_ in blind} == {(107.0, -1.0), (90.0, -0.7)}, "and the others are lost"


def test_a_stretched_balls_edges_are_looked_for_ahead_and_behind() -> None:
    stretched = BALL._replace(r=6.0, stretch=1.0)  # the rims at -1 ms: 104 + 2 ahead, 92 - 2 behind
    ahead, behind = column_at(END_US - 1000, 106, True), column_at(END_US - 1000, 90, False)
    points, _ = found(recent(*ahead, *behind), stretched)
    assert {u for u, *_ in points} == {106.0, 90.0}
    assert found(recent(*ahead, *behind), stretched._replace(r=10.0))[0] == [], "too large for them"


def test_one_that_turns_is_looked_for_on_its_curve() -> None:
    turning = BALL._replace(av=8.0)
    points, _ = found(recent(*[(END_US - 1000, 106, y, True) for y in range(62, 67)]), turning)
    assert {(u, v) for u, v, *_ in points} == {(106.0, 63.0), (106.0, 64.0), (106.0, 65.0)}
    assert turning.at(-1.0)[:4] == (98.0, 64.0, 2.0, -8.0)


def test_a_pixel_alone_and_one_far_from_the_rim_are_no_edge() -> None:
    alone, far = [(END_US - 1000, 106, 60, True)], column_at(END_US - 1000, 112, True)
    assert found(recent(*alone, *far)) == ([], 0)


def test_what_began_before_the_history_or_may_not_be_over_is_left_out() -> None:
    early = column_at(END_US - 3500, 101, True) + column_at(END_US - 2900, 101, True)  # the rim was there at -3.5 ms
    late = column_at(END_US - 200, 92, False)  # the trailing rim, but the guard is 0.5 ms
    points, _ = found(recent(*early, *late))
    assert points == []


def test_events_in_the_middle_of_the_disc_are_counted() -> None:
    points, inside = found(recent(*column_at(END_US - 500, 99, True), *column_at(END_US - 400, 99, False)))
    assert points == [] and inside == 6


def test_events_at_the_sensors_corner_are_read_without_reaching_over_it() -> None:
    ball = MovingCircle(2.0, 2.0, 2.0, 0.0, 8.0)
    points, _ = found(recent(*[(END_US - 1000, 8, y, True) for y in range(5)]), ball)
    assert [(u, v) for u, v, *_ in points] == [(8.0, 1.0), (8.0, 2.0), (8.0, 3.0)]


@pytest.mark.parametrize(("speed", "history_ms"), [(0.01, 16.0), (0.5, 7.0), (1.75, 2.0), (20.0, 2.0)])
def test_the_history_is_a_length_of_motion_within_its_bounds(speed: float, history_ms: float) -> None:
    span = span_for(END_US, speed, Reach(3.5, 2.0, 16.0))
    assert span.history_ms == pytest.approx(history_ms)
    assert span.gather_ms > span.history_ms > 2 * span.guard_ms > 0
