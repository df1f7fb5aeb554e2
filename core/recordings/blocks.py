"""Columns as HDF5 stores them with `shuffle` and `gzip`, packed and unpacked by several threads and without HDF5.

HDF5's own filters run one at a time under one lock. The bytes made here are the ones those filters would make, so a
plain h5py reads them. ISA-L deflates a column of events 8 times faster than zlib at level 1 and into a similar size
(measured: 10 against 80 ns for the 13 bytes of an event). Short columns go through zlib: ISA-L deflates the same 48
bytes in two ways, one process in 150 in the other, and the same simulation must end in the same file.
"""

from __future__ import annotations

import zlib
from typing import Final, cast

import numpy as np
from isal import isal_zlib
from numpy.typing import DTypeLike, NDArray

from core.jit import njit

CHUNK_EVENTS: Final = 32768
"""Events in one chunk: small enough that a 1 ms slice decodes little, large enough that calls cost little."""
GZIP_LEVEL: Final = 1
SHORT_BYTES: Final = CHUNK_EVENTS
"""Columns of fewer bytes are deflated by zlib: no column of a chunk of events is."""
_ZLIB_WRAPPED: Final = 15
"""`wbits` of zlib for a stream with header and checksum, the deflate filter of HDF5."""
_DEFLATE_ERROR = cast("type[Exception]", isal_zlib.error)  # its type stub calls the class an instance


def pack_column(column: NDArray, length: int) -> bytes:
    """One HDF5 chunk of `length` rows that holds `column`, padded with zeros, shuffled and deflated."""
    if len(column) < length:
        padded = np.zeros((length, *column.shape[1:]), column.dtype)
        padded[: len(column)] = column
        column = padded
    planes = shuffle_bytes(np.ascontiguousarray(column))
    if planes.nbytes < SHORT_BYTES:
        return zlib.compress(planes.tobytes(), GZIP_LEVEL)
    return isal_zlib.compress(planes, GZIP_LEVEL, _ZLIB_WRAPPED)


def unpack_column(packed: bytes, dtype: DTypeLike, shape: tuple[int, ...], *, shuffled: bool = True) -> NDArray:
    """The read-only array in one deflated chunk.

    Raises:
        ValueError: if the bytes are damaged or hold another number of values.
    """
    dtype = np.dtype(dtype)
    count = int(np.prod(shape, dtype=np.int64))
    try:
        raw = isal_zlib.decompress(packed, _ZLIB_WRAPPED, max(1, count * dtype.itemsize))
    except _DEFLATE_ERROR as error:
        raise ValueError(f"a compressed block is damaged ({error})") from error
    if len(raw) != count * dtype.itemsize:
        raise ValueError(f"a compressed block holds {len(raw)} bytes, expected {count * dtype.itemsize}")
    if shuffled and dtype.itemsize > 1:
        column = unshuffle_bytes(np.frombuffer(raw, np.uint8), dtype).reshape(shape)
    else:
        column = np.frombuffer(raw, dtype).reshape(shape)
    column.flags.writeable = False
    return column


def shuffle_bytes(column: NDArray) -> NDArray[np.uint8]:
    """All first bytes of the values, then all second bytes, and so on: HDF5's shuffle filter."""
    size = column.dtype.itemsize
    if size == 1:
        return column.reshape(-1).view(np.uint8)
    if size == 2 or size == 8:
        words = column.reshape(-1).view(np.uint16 if size == 2 else np.uint64)
        planes = np.empty(words.size * size, np.uint8)
        (_split2 if size == 2 else _split8)(words, planes)
        return planes
    return np.ascontiguousarray(column.reshape(-1).view(np.uint8).reshape(-1, size).T).reshape(-1)


def unshuffle_bytes(planes: NDArray[np.uint8], dtype: np.dtype) -> NDArray:
    """The inverse of `shuffle_bytes`."""
    size = dtype.itemsize
    if size == 2 or size == 8:
        words = np.empty(planes.size // size, np.uint16 if size == 2 else np.uint64)
        (_join2 if size == 2 else _join8)(planes, words)
        return words.view(dtype)
    return np.ascontiguousarray(planes.reshape(size, -1).T).reshape(-1).view(dtype)


# One plain loop per byte plane or word: the compiler turns them into vector code (5 times faster than a general loop).


@njit
def _split2(words, planes):
    n = words.size
    for i in range(n):
        planes[i] = np.uint8(words[i])
    for i in range(n):
        planes[n + i] = np.uint8(words[i] >> 8)


@njit
def _split8(words, planes):
    n = words.size
    for j in range(8):
        bits = np.uint64(8 * j)
        for i in range(n):
            planes[j * n + i] = np.uint8(words[i] >> bits)


@njit
def _join2(planes, words):
    n = words.size
    for i in range(n):
        words[i] = np.uint16(planes[i]) | (np.uint16(planes[n + i]) << np.uint16(8))


@njit
def _join8(planes, words):
    n = words.size
    for i in range(n):
        word = np.uint64(planes[i])
        for j in range(1, 8):
            word |= np.uint64(planes[j * n + i]) << np.uint64(8 * j)
        words[i] = word
