"""A recorded rally that is shown while the app is prepared: pictures of the 3D scene in a file that comes with it.

It needs nothing compiled. `python -m docs.make_example_rally` makes the file.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import cache
from importlib import resources
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from core.history.rally_picture import LandingSpot, Pose, RallyPicture, UncertaintyEllipse
from core.physics.episode import Case

Array = NDArray[np.float64]
FILE: Final = "example_rally.npz"
STRIDE_US: Final = 20_000
"""Time of the rally between two pictures."""
AFTER_S: Final = 2.5
"""Time of waiting from which on it is shown: where all is compiled, the live rally comes sooner."""
SPEED: Final = 0.5
"""Seconds of the rally per second of wall time."""
DECIMALS: Final = 4
"""Decimals that are kept of metres: a tenth of a millimetre."""
LEFT_OUT: Final = ("people", "hit_places", "refused_places", "no_stroke")
"""Fields that the file does not have: it shows the paper's plane."""
NONE: Final = -1
"""Length that stands for a value that is None."""


class ExampleRally:
    """Shows the pictures one after the other, again and again. Called by the loop of a browser's session."""

    def __init__(self, draw: Callable[[RallyPicture], None], *, after_s: float = AFTER_S) -> None:
        """`after_s`: time of waiting from which on it is shown."""
        self._draw = draw
        self._after_s = after_s
        self._begun_s: float | None = None
        self._drawn_s = float("-inf")
        self._number = NONE

    @property
    def is_shown(self) -> bool:
        """Whether a picture was drawn."""
        return self._number != NONE

    def tick(self, wall_s: float, every_s: float) -> None:
        """Draw the picture of this moment, if it is another one than before, and that is `every_s` ago."""
        if wall_s - self._drawn_s < every_s:
            return
        self._begun_s = wall_s + self._after_s if self._begun_s is None else self._begun_s
        if wall_s < self._begun_s:
            return
        pictures = example_pictures()
        number = int((wall_s - self._begun_s) * SPEED * 1e6 / STRIDE_US) % len(pictures)
        if number != self._number:
            self._number, self._drawn_s = number, wall_s
            self._draw(pictures[number])


@cache
def example_pictures() -> tuple[RallyPicture, ...]:
    """The pictures that come with the app, STRIDE_US apart."""
    return unpack_pictures((resources.files("app.startup") / FILE).read_bytes())


def pack_pictures(pictures: Sequence[RallyPicture]) -> bytes:
    """Pictures as an npz: all values of a field one after the other, and their lengths, without LEFT_OUT."""
    columns = {}
    for name in _READERS:
        values = [_flat(name, getattr(picture, name)) for picture in pictures]
        columns[f"{name}_lengths"] = np.array([NONE if one is None else len(one) for one in values], np.int32)
        whole = np.concatenate([one for one in values if one is not None] or [np.empty(0)])
        columns[name] = np.round(whole, DECIMALS).astype(np.float32)
    packed = io.BytesIO()
    np.savez_compressed(packed, allow_pickle=False, **columns)
    return packed.getvalue()


def unpack_pictures(data: bytes) -> tuple[RallyPicture, ...]:
    """Inverse of `pack_pictures`."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        columns = {name: _values(file[name], file[f"{name}_lengths"]) for name in _READERS}
    rows = zip(*columns.values(), strict=True)
    return tuple(
        RallyPicture(**{name: _value(name, flat) for name, flat in zip(columns, row, strict=True)}) for row in rows
    )


def _value(name: str, flat: Array | None) -> Any:  # a field's own type, which only its name tells
    return None if flat is None else _READERS[name](flat)


def _values(flat: NDArray[np.float32], lengths: NDArray[np.int32]) -> list[Array | None]:
    ends = np.cumsum(np.maximum(lengths, 0))
    parts = np.split(flat.astype(np.float64), ends[:-1])
    return [None if length == NONE else part for length, part in zip(lengths, parts, strict=True)]


def _flat(name: str, value: object) -> Array | None:
    """Numbers of a field's value, in the order in which its reader takes them."""
    match value:
        case None:
            return None
        case Pose():
            return np.concatenate([value.p_world_m, value.wxyz])
        case float():
            return np.array([value])
        case tuple() if name == "rays":
            return np.array(value, np.float64).ravel()
        case tuple() if name == "spreads":
            return np.array([np.concatenate([one.centre, one.axes.ravel()]) for one in value], np.float64).ravel()
        case tuple():
            return np.array([(one.x_m, one.y_m, one.case.value) for one in value], np.float64).ravel()
        case _:
            return np.asarray(value, np.float64).ravel()


def _points(flat: Array) -> Array:
    return flat.reshape(-1, 3)


def _pose(flat: Array) -> Pose:
    return Pose(flat[:3], flat[3:])


def _rays(flat: Array) -> tuple[tuple[Array, Array], ...]:
    return tuple((first, last) for first, last in flat.reshape(-1, 2, 3))


def _spreads(flat: Array) -> tuple[UncertaintyEllipse, ...]:
    return tuple(UncertaintyEllipse(row[:3], row[3:].reshape(2, 3)) for row in flat.reshape(-1, 9))


def _spots(flat: Array) -> tuple[LandingSpot, ...]:
    return tuple(LandingSpot(float(x), float(y), Case(round(case))) for x, y, case in flat.reshape(-1, 3))


_READERS: Final[dict[str, Callable[[Array], Any]]] = {
    **{one.name: lambda flat: flat for one in fields(RallyPicture) if one.name not in LEFT_OUT},
    **dict.fromkeys(("trail", "before_bounce", "after_bounce", "tube", "tube_sigmas"), _points),
    **dict.fromkeys(("bounce_in_s", "hit_in_s"), lambda flat: float(flat[0])),
    **dict.fromkeys(("racket", "racket_target"), _pose),
    "rays": _rays,
    "spreads": _spreads,
    "spots": _spots,
}
"""Field of a RallyPicture -> its value from the numbers."""
