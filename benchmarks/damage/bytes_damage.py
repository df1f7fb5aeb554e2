"""Damage that knows nothing of what it damages: bits, cuts, pieces that are gone, doubled or in another place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

ByteAct = Callable[[bytes, np.random.Generator], bytes]


def damage_bytes(data: bytes, rng: np.random.Generator) -> tuple[str, bytes]:
    """The name of a damage and what it leaves."""
    name, act = ACTS[int(rng.integers(len(ACTS)))]
    return name, act(data, rng)


def _place(data: bytes, rng: np.random.Generator) -> int:
    """Half of all damages hit the first kilobytes, where most formats keep what the rest means."""
    end = min(len(data), 4096) if rng.random() < 0.5 else len(data)
    return int(rng.integers(max(1, end)))


def _flip(data: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        if changed:
            changed[_place(data, rng)] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _garbage(data: bytes, rng: np.random.Generator) -> bytes:
    at, size = _place(data, rng), int(2 ** rng.integers(0, 10))
    return data[:at] + rng.bytes(size) + data[at + size :]


def _same_byte(data: bytes, rng: np.random.Generator) -> bytes:
    at, size = _place(data, rng), int(2 ** rng.integers(0, 13))
    return data[:at] + bytes([0 if rng.random() < 0.5 else 255]) * len(data[at : at + size]) + data[at + size :]


def _cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: _place(data, rng)]


def _take_out(data: bytes, rng: np.random.Generator) -> bytes:
    at = _place(data, rng)
    return data[:at] + data[at + int(2 ** rng.integers(0, 12)) :]


def _insert(data: bytes, rng: np.random.Generator) -> bytes:
    at = _place(data, rng)
    return data[:at] + rng.bytes(int(2 ** rng.integers(0, 12))) + data[at:]


def _move(data: bytes, rng: np.random.Generator) -> bytes:
    source, target, size = _place(data, rng), _place(data, rng), int(2 ** rng.integers(0, 12))
    piece = data[source : source + size]
    return data[:target] + piece + data[target + len(piece) :]


ACTS: Final[tuple[tuple[str, ByteAct], ...]] = (
    ("flipped bits", _flip),
    ("garbage", _garbage),
    ("zeros or ones", _same_byte),
    ("cut", _cut),
    ("bytes taken out", _take_out),
    ("bytes inserted", _insert),
    ("a piece elsewhere", _move),
)
