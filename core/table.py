"""The table, the net and the ball, in metres (ITTF). World frame: origin at the centre of the table's top surface."""

from __future__ import annotations

from typing import Final

TABLE_LENGTH_M: Final = 2.74
"""Along x."""
TABLE_WIDTH_M: Final = 1.525
"""Along y."""
TABLE_HEIGHT_M: Final = 0.76
"""Top surface above the floor: the floor is at z = -TABLE_HEIGHT_M."""
LINE_WIDTH_M: Final = 0.02
CENTRE_LINE_WIDTH_M: Final = 0.003
NET_HEIGHT_M: Final = 0.1525
NET_OVERHANG_M: Final = 0.1525
"""How far the net stands out beyond each side line."""
BALL_RADIUS_M: Final = 0.020
BALL_MASS_KG: Final = 0.0027
GRAVITY_MPS2: Final = 9.81
