"""Columns that grow and are forgotten hold what a plain list of pieces holds, and what was read never changes."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from core.live.ring_recording import MIN_ROWS, RingBuffer

STEPS = st.lists(
    st.tuples(st.sampled_from(["put", "put", "put", "late", "forget"]), st.integers(0, MIN_ROWS)), max_size=60
)


@given(STEPS)
def test_it_holds_what_a_list_of_pieces_holds_and_readers_keep_what_they_read(steps) -> None:
    ring, pieces, newest, value = RingBuffer(), {}, 0, 0
    read: list[tuple[tuple, tuple]] = []
    for what, size in steps:
        if what == "forget":
            ring.forget_before(newest - size % 5)
            pieces = {number: piece for number, piece in pieces.items() if number >= newest - size % 5}
        else:
            newest += what == "put"
            number = newest if what == "put" else max(newest - size % 7, 0)
            piece = (np.arange(value, value + size), np.full((size, 3), value, np.float32))
            value += size
            ring.put(number, piece)
            pieces[number] = piece
        told = ring.columns
        assert (told is None) == (not pieces)
        if told is not None:
            whole = tuple(np.concatenate([pieces[number][k] for number in sorted(pieces)]) for k in range(2))
            assert all(np.array_equal(*both) for both in zip(told, whole, strict=True))
            assert told[1].dtype == np.float32 and told[1].shape[1:] == (3,)
            read.append((told, whole))
    for told, whole in read:
        assert all(np.array_equal(*both) for both in zip(told, whole, strict=True))


def test_room_does_not_grow_with_what_was_forgotten() -> None:
    ring = RingBuffer()
    for number in range(20_000):
        ring.put(number, (np.full(10, number),))
        ring.forget_before(number - 100)
    (column,) = ring.columns
    assert len(column) == 1010 and column.base is not None and len(column.base) <= 4 * 1010
