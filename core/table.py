"""The table, the net, the ball (ITTF) and the air, and how real ones fly and bounce.

World frame: origin at the centre of the table's top surface.
"""

from __future__ import annotations

from typing import Final, NamedTuple

TABLE_LENGTH_M: Final = 2.74
"""Along x."""
TABLE_WIDTH_M: Final = 1.525
"""Along y."""
TABLE_HEIGHT_M: Final = 0.76
"""Top surface above the floor: the floor is at z = -TABLE_HEIGHT_M."""
LINE_WIDTH_M: Final = 0.02
CENTRE_LINE_WIDTH_M: Final = 0.003
"""White lines along the edges, and of doubles in the middle. Sizes of table, net and ball: ITTF laws 2.1 to 2.3."""
NET_HEIGHT_M: Final = 0.1525
NET_OVERHANG_M: Final = 0.1525
"""How far the net stands out beyond each side line."""
BALL_RADIUS_M: Final = 0.020
BALL_MASS_KG: Final = 0.0027
"""A ball of 40 mm and 2.7 g."""
GRAVITY_MPS2: Final = 9.81
AIR_KG_PER_M3: Final = 1.204
"""Dry air at 20 degrees Celsius and sea level."""


class FittedConstant(NamedTuple):
    """What recorded flights say of a constant of the profile `real`, by `rallyscope fit-physics`.

    docs/measured/physics-report.md has the fits.

    49 of the 70 flights that tt3d published (two players, one table and ball, 179 Hz, 3 to 12 m/s, one bounce each),
    all constants and each flight's start and spin fitted together, with the Magnus coefficient given as .10.
    """

    value: float
    sigma: float
    """Spread over bootstrap samples of the flights. The model adds its own: with a Magnus coefficient of .125 the drag
    becomes .533, the restitution .940 and the friction .247."""


REAL_DRAG: Final = FittedConstant(0.554, 0.008)
REAL_RESTITUTION: Final = FittedConstant(0.945, 0.009)
REAL_FRICTION: Final = FittedConstant(0.227, 0.010)
REAL_MAGNUS: Final = 0.10
"""Given, not fitted: flights without spin labels fix only its product with the spin."""
