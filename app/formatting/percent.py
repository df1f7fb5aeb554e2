"""Shares in words: all is all, and nothing is nothing."""

from __future__ import annotations

import math


def percent(share: float) -> str:
    """A share 0 to 1 as a whole per cent; 259 of 260 is 99 %, as 100 % says that none is left out."""
    value = 100.0 * share
    if 0.0 < value < 1.0:
        return "1 %"
    return f"{math.floor(value + 1e-9) if value > 99.0 else round(value)} %"
