"""Bounds of what travels over the link."""

from __future__ import annotations

from typing import Final

MAX_EVENTS: Final = 2_000_000
"""In one batch: two hundred times what a busy block of 10 ms holds."""
MAX_ROWS: Final = 10_000
COMMAND_BYTES: Final = 64 << 10
MESSAGE_BYTES: Final = 32 << 20
LONGEST_US: Final = 24 * 3600 * 1_000_000
WALL_NS: Final = 1 << 62
