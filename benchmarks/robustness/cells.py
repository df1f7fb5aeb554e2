"""The rows of the table: what is wrong in each, and what is told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

Constant = Literal["drag", "restitution", "friction"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One row. Signs, directions, cameras and instants are drawn; the sizes are these."""

    name: str
    """For `--only`."""
    words: str
    told: str = ""
    """What is told exactly of what is otherwise found out; empty: nothing."""
    constant: Constant | None = None
    sigmas: float = 0.0
    """By so many of its standard deviations the constant is not what is expected, up or down."""
    pixels: float = 0.0
    """By which each camera's principal point was calibrated wrong, in a random direction."""
    degrees: float = 0.0
    """By which each camera's orientation was calibrated wrong, about a random axis."""
    clock_ms: float = 0.0
    """By which the stamps of one of the cameras are late."""
    latency_ms: float = 0.0
    """From a command to its effect."""
    jitter_ms: float = 0.0
    """Half the range by which that differs from command to command."""
    led: bool = True
    """Whether the controller leads by what a step test found of the latency."""
    racket_deg: float = 0.0
    """By which the racket stands otherwise than commanded, about a random axis, each ball another."""
    lamp: bool = False
    """A lamp in both pictures flickers a hundred times a second."""
    blocked_ms: float = 0.0
    """For so long one camera sees nothing, once a flight."""


TOLD: Final = Cell(name="told", words="nothing is wrong", told="air, table")
CELLS: Final = (
    TOLD,
    Cell(name="nothing-told", words="nothing is wrong"),
    *(
        Cell(name=f"{constant}-{sigmas}", words=f"{constant} {sigmas} sigma", constant=constant, sigmas=sigmas)
        for constant in ("drag", "restitution", "friction")
        for sigmas in (1, 2)
    ),
    *(Cell(name=f"calibration-{px:g}px", words=f"calibration {px:g} px", pixels=px) for px in (0.2, 0.5, 1.0)),
    Cell(name="calibration-half-degree", words="calibration 0.5 degree", degrees=0.5),
    *(Cell(name=f"clock-{ms:g}ms", words=f"clock of a camera {ms:g} ms", clock_ms=ms) for ms in (0.2, 1.0)),
    Cell(name="latency-10", words="commands 10 ms late, led", latency_ms=10.0),
    Cell(name="latency-40", words="commands 40 ms late, led", latency_ms=40.0),
    Cell(name="latency-40-jitter", words="commands 40 +- 5 ms late, led", latency_ms=40.0, jitter_ms=5.0),
    Cell(name="latency-40-unled", words="commands 40 +- 5 ms late, not led", latency_ms=40.0, jitter_ms=5.0, led=False),
    Cell(name="racket-1-degree", words="racket 1 degree off", racket_deg=1.0),
    Cell(name="flicker", words="a lamp flickers at 100 Hz", lamp=True),
    Cell(name="blocked-20ms", words="a camera blocked for 20 ms", blocked_ms=20.0),
)
"""In the order of the table."""
