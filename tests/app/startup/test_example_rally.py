"""The recorded rally that is shown while the app is prepared."""

import dataclasses

import numpy as np

from app.startup.example_rally import (
    AFTER_S,
    LEFT_OUT,
    SPEED,
    STRIDE_US,
    ExampleRally,
    example_pictures,
    pack_pictures,
    unpack_pictures,
)
from core.history.rally_picture import LandingSpot, Pose, RallyPicture, UncertaintyEllipse
from core.physics.episode import Case


def flat(value: object) -> list[float] | None:
    """All numbers of a value, however deep they are."""
    if value is None:
        return None
    if dataclasses.is_dataclass(value):
        value = [getattr(value, one.name) for one in dataclasses.fields(value)]
    if isinstance(value, tuple | list):
        return [number for part in value for number in flat(part) or ()]
    return np.ravel(np.asarray(value, np.float64)).tolist()


def test_every_field_of_a_picture_is_read_back() -> None:
    points, q = np.arange(12.0).reshape(4, 3), np.array([1.0, 0.0, 0.0, 0.0])
    full = RallyPicture(
        ball=points[0], trail=points, trail_speeds_mps=np.arange(4.0), truth=points[1],
        rays=((points[0], points[1]), (points[2], points[1])), before_bounce=points[:2], after_bounce=points[1:],
        tube=points, tube_sigmas=points * 0.01, spreads=(UncertaintyEllipse(points[0], points[:2]),), bounce=points[2],
        bounce_in_s=0.25, hit=points[3], hit_in_s=0.5, racket=Pose(points[0], q), racket_target=Pose(points[1], q),
        landing_target=np.array([0.7, 0.1]), spots=(LandingSpot(0.5, -0.25, Case.RETURNED),),
    )  # fmt: skip
    empty = RallyPicture()
    read = unpack_pictures(pack_pictures([full, empty, full]))
    for name in {one.name for one in dataclasses.fields(RallyPicture)} - {*LEFT_OUT}:
        assert flat(getattr(read[0], name)) == flat(getattr(read[2], name)), name
        assert np.allclose(flat(getattr(read[0], name)) or (), flat(getattr(full, name)) or (), atol=1e-4), name
        assert flat(getattr(read[1], name)) == flat(getattr(empty, name)), name


def test_the_rally_that_comes_with_the_app_shows_returned_balls() -> None:
    pictures = example_pictures()
    assert [spot.case for spot in pictures[-1].spots] == [Case.RETURNED, Case.RETURNED]
    assert any(picture.hit_in_s is not None and picture.racket_target is not None for picture in pictures)


def test_it_is_drawn_again_and_again_and_no_oftener_than_asked() -> None:
    drawn: list[RallyPicture] = []
    example, count = ExampleRally(drawn.append), len(example_pictures())
    frame_s = 1e-6 * STRIDE_US / SPEED
    for wall_s in (100.0 - AFTER_S, 99.9):
        example.tick(wall_s, 0.0)
    assert not drawn, "the live rally may come at once"
    for number in range(4 * (count + 1)):
        example.tick(100.0 + (number / 4 + 0.1) * frame_s, 0.0)
    assert len(drawn) == count + 1 and drawn[0] is drawn[count]
    seldom = ExampleRally(drawn.append)
    seldom.tick(100.0 - AFTER_S, 0.45)
    drawn.clear()
    for number in range(10):
        seldom.tick(100.0 + 0.1 * number, 0.45)
    assert len(drawn) == 2


def test_where_something_is_compiled_first_it_is_shown_at_once() -> None:
    drawn: list[RallyPicture] = []
    example = ExampleRally(drawn.append, after_s=0.0)
    assert not example.is_shown
    example.tick(100.0, 0.0)
    assert len(drawn) == 1 and example.is_shown
