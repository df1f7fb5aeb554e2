"""How a player's racket moves: key poses of each stroke, joined by curves that do not overshoot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SWING_BACK_S: Final = 0.28
FOLLOW_S: Final = 0.12
RECOVER_S: Final = 0.50
"""Times of a stroke's key poses before and after the contact (choice: an amateur's drive, 2 to 4 m/s at the blade)."""


@dataclass(frozen=True, slots=True, eq=False)
class PlayerStroke:
    """The blade meets the ball."""

    t_s: float
    p_world_m: Array
    """(3,) of the middle of the blade's face."""
    normal_world: Array
    """(3,) of the face, away from the blade."""


class RacketMotion:
    """Blade and feet of a player who stands at `home` and looks along `forward`, with the racket on side `left`.

    Between strokes the player comes back to a ready pose. With `cycle_s` everything repeats.
    """

    def __init__(
        self, home_m: Array, forward: Array, side: Array, strokes: Sequence[PlayerStroke], cycle_s: float | None
    ) -> None:
        from scipy.interpolate import PchipInterpolator  # loaded late: most scenes have no people

        up = np.array([0.0, 0.0, 1.0])
        ready = home_m + 0.45 * forward + 0.22 * side + 0.12 * up
        at_s, blades, normals, feet = [-1.0], [ready], [forward + 0.2 * up], [home_m]
        for index, stroke in enumerate(strokes):
            stand = stroke.p_world_m - 0.50 * forward - 0.42 * side
            stand = np.array([stand[0], stand[1], home_m[2]])
            poses = (
                (-SWING_BACK_S, stroke.p_world_m - 0.40 * forward + 0.12 * side - 0.08 * up, forward + 0.6 * side),
                (0.0, stroke.p_world_m, stroke.normal_world),
                (FOLLOW_S, stroke.p_world_m + 0.28 * forward - 0.14 * side + 0.22 * up, forward - 0.6 * side),
            )
            for after_s, blade, normal in poses:
                at_s.append(stroke.t_s + after_s)
                blades.append(blade)
                normals.append(normal / np.linalg.norm(normal))
                feet.append(stand)
            following_s = strokes[index + 1].t_s - SWING_BACK_S if index + 1 < len(strokes) else np.inf
            if stroke.t_s + RECOVER_S < following_s - 0.1:
                at_s.append(stroke.t_s + RECOVER_S)
                blades.append(ready)
                normals.append(forward + 0.2 * up)
                feet.append(home_m)
        last_s = max(at_s[-1] + 1.0, cycle_s or 0.0)
        at_s.append(last_s)
        self._first_s, self._last_s, self._cycle_s = at_s[0], last_s, cycle_s
        columns = [np.concatenate(pose) for pose in zip(blades, normals, feet, strict=True)]
        columns.append(np.concatenate([ready, forward + 0.2 * up, home_m]))
        self._curves = PchipInterpolator(at_s, np.array(columns), axis=0)

    def at(self, t_s: Array) -> tuple[Array, Array, Array]:
        """(middle of the face, unit normal, where the player stands), each (N, 3)."""
        t = np.mod(t_s, self._cycle_s) if self._cycle_s is not None else np.clip(t_s, self._first_s, self._last_s)
        values = self._curves(t)
        normals = values[:, 3:6] / np.linalg.norm(values[:, 3:6], axis=1, keepdims=True)
        return values[:, :3], normals, values[:, 6:]


def practice(
    home_m: Array, forward: Array, side: Array, cycle_s: float, rng: np.random.Generator
) -> list[PlayerStroke]:
    """Strokes without a ball, every 1.1 to 2 s, ending before the cycle does."""
    strokes, t_s = [], 0.6 + rng.uniform(0.0, 0.8)
    while t_s < cycle_s - 2.0:
        across, height = rng.uniform(-0.25, 0.35), rng.uniform(0.08, 0.40)
        p = home_m + (0.50 + rng.uniform(-0.1, 0.1)) * forward + (0.42 + across) * side
        p[2] = height
        normal = forward + rng.uniform(-0.2, 0.4) * np.array([0.0, 0.0, 1.0])
        strokes.append(PlayerStroke(t_s, p, normal / np.linalg.norm(normal)))
        t_s += rng.uniform(1.1, 2.0)
    return strokes
