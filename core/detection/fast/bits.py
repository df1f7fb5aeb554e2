"""What is done with the 64 pixels of a word at once."""

from __future__ import annotations

from typing import Final

import numpy as np
from llvmlite import ir
from numba import types
from numba.cpython.unsafe.numbers import trailing_zeros
from numba.extending import intrinsic

from core.jit import njit

ONE: Final = np.uint64(1)
SIX: Final = np.uint64(6)
LAST: Final = np.uint64(63)


@njit(forceinline=True)
def popcount(word):
    """How many bits of a uint64 are set."""
    return _popcount(word)  # pyright: ignore[reportCallIssue] - a numba intrinsic


@njit(forceinline=True)
def lowest_place(word):
    """The place of the lowest set bit of a uint64, from 0."""
    return np.int64(trailing_zeros(word))  # pyright: ignore[reportCallIssue] - a numba intrinsic


@intrinsic
def _popcount(typing_context, word):
    """Numba has no such function of its own."""

    def emit(context, builder, signature, arguments):
        return builder.ctpop(builder.bitcast(arguments[0], ir.IntType(64)))

    return types.int64(types.uint64), emit
