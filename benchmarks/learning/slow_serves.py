"""What limits the return of slow serves in the physics called real: the share of balls that any stroke returns, with
one bound of the racket after another set free.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Final

from core.learning.config import EnvironmentConfig, environment_profile
from core.learning.evaluation.reachable import Reachable, reachable
from core.metrics.intervals import binomial_interval
from core.physics.task import RacketSpeedConfig
from core.text.markdown_table import markdown_table

HEADING: Final = "## What limits slow serves"
SPEED_MPS: Final = 3.0
BALLS: Final = 200
NOTE: Final = """Serves of {speed:g} m/s in the physics `real`, which come to the hitting plane low and steeply down. A
ball is returnable if a stroke on a grid within the bounds returns it, whatever the target (`rallyscope bench learning
--only slow-serves`; {balls} balls a row with the 95 % interval of Wilson, no training, no seeds). Height is of the
ball's centre above the table's top where it is to be hit, the angle is below the horizontal; medians. Rows with another
hitting plane have other balls: such as reach that plane.
"""


def slow_serve_rows(
    progress: Callable[[float], None] = lambda share: None, balls: int = BALLS
) -> list[dict[str, object]]:
    """A row per set of bounds."""
    cases = _cases()
    rows: list[dict[str, object]] = []
    for number, (words, environment) in enumerate(cases.items()):
        rows.append(_row(words, reachable(environment, SPEED_MPS, balls), balls))
        progress((number + 1) / len(cases))
    return rows


def slow_serves_section(rows: list[dict[str, object]]) -> str:
    """The section of the report."""
    cells = []
    for row in rows:
        share, low, high = (100 * float(str(row[name])) for name in ("returnable", "low", "high"))
        cells.append([row["bounds"], f"{share:.0f} [{low:.0f}, {high:.0f}]", row["height_cm"], row["falling_deg"]])
    table = markdown_table(
        ("bounds", "returnable, % [95 %]", "height, cm", "angle, degrees"), cells, ("", "", ".1f", ".0f")
    )
    return f"{HEADING}\n\n{NOTE.format(speed=SPEED_MPS, balls=rows[0]['balls'])}\n{table}"


def _cases() -> dict[str, EnvironmentConfig]:
    real = environment_profile("real", state_source="truth")
    chosen = dataclasses.replace(real, racket="chosen")
    return {
        "as they are: +-15 degrees, 3.8 m/s": real,
        "the racket's speed chosen, 0 to 4.5 m/s": chosen,
        "3 m/s": _with(real, speed=3.0),
        "6 m/s": _with(real, speed=6.0),
        "+-25 degrees": _with(real, limit_deg=25.0),
        "+-40 degrees": _with(real, limit_deg=40.0),
        "+-40 degrees, speed chosen": _with(chosen, limit_deg=40.0),
        "the base tilted up by 15 degrees": _with(real, base_deg=15.0),
        "hit at x = -1.30 m, over the table": _with(real, plane_m=-1.30),
        "hit at x = -1.20 m": _with(real, plane_m=-1.20),
    }


def _with(
    environment: EnvironmentConfig,
    *,
    speed: float | None = None,
    limit_deg: float | None = None,
    base_deg: float = 0.0,
    plane_m: float | None = None,
) -> EnvironmentConfig:
    stroke = dataclasses.replace(environment.task.stroke, base_pitch_deg=base_deg)
    if speed is not None:
        stroke = dataclasses.replace(stroke, racket_speed=RacketSpeedConfig(at_3_mps=speed))
    if limit_deg is not None:
        stroke = dataclasses.replace(stroke, action_limit_deg=limit_deg)
    if plane_m is not None:
        stroke = dataclasses.replace(stroke, hit_plane_x_m=plane_m)
    return dataclasses.replace(environment, task=dataclasses.replace(environment.task, stroke=stroke))


def _row(words: str, found: Reachable, balls: int) -> dict[str, object]:
    low, high = binomial_interval(found.share, balls)
    return {
        "bounds": words,
        "balls": balls,
        "returnable": found.share,
        "low": low,
        "high": high,
        "height_cm": 100 * found.height_m,
        "falling_deg": found.falling_deg,
    }
