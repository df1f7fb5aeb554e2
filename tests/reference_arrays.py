"""Outputs of any kind as named arrays, what is kept of an array, and how an array differs from what was kept."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import cv2
import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

SAMPLES: Final = 6
"""Values of an array that are kept."""
TOLERANCE: Final = 1e-6
"""Relative and absolute, for what another machine rounds otherwise."""
KEPT: Final = ("type", "shape", "hash")
"""What decides whether an array is the same."""
NUMBER: Final = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")

Arrays = dict[str, NDArray]
Json = dict[str, object]


def read_files(path: Path) -> Arrays:
    """A file, or every file in a folder, by kind."""
    if path.is_dir():
        inside = sorted(one for one in path.rglob("*") if one.is_file())
        return {f"{one.relative_to(path)}/{name}": array for one in inside for name, array in read_files(one).items()}
    if h5py.is_hdf5(path):
        return read_hdf5(path)
    if path.suffix == ".png":
        return {"pixels": np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))}
    if path.suffix == ".raw":
        return {"bytes": bytes_array(path.read_bytes())}
    return text_arrays(path)


def read_hdf5(path: Path) -> Arrays:
    """Every data set in a file."""
    arrays: Arrays = {}

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            arrays[name] = np.asarray(item[()], np.dtype(item.dtype.str))  # without h5py's remarks on the type

    with h5py.File(path) as file:
        file.visititems(visit)
    return arrays


def text_arrays(path: Path) -> Arrays:
    """A text file."""
    return text_columns(path.name, path.read_text(encoding="utf-8"))


def text_columns(name: str, text: str) -> Arrays:
    """The numbers in a text, and its words as bytes with a mark in each number's place."""
    numbers = np.array([float(found) for found in NUMBER.findall(text)])
    return {f"{name}: words": bytes_array(NUMBER.sub("#", text).encode()), f"{name}: numbers": numbers}


def bytes_array(data: bytes) -> NDArray[np.uint8]:
    """Bytes as numbers."""
    return np.frombuffer(data, np.uint8)


def stacked(parts: list[Arrays]) -> Arrays:
    """Columns of the same names, one below the other."""
    names = dict.fromkeys(name for part in parts for name in part)
    return {name: np.concatenate([part[name] for part in parts if name in part]) for name in names}


def summarise(array: ArrayLike) -> Json:
    """What is kept of an array: type, shape, hash, and some values."""
    plain = np.ascontiguousarray(array)
    summary: Json = {
        "type": plain.dtype.str,
        "shape": list(plain.shape),
        "hash": hashlib.blake2b(plain.tobytes(), digest_size=8).hexdigest(),
    }
    if plain.dtype.kind in "iuf" and plain.size and plain.dtype != np.uint8:
        summary["values"] = [None if value != value else value for value in sampled(plain).tolist()]
    return summary


def sampled(array: NDArray) -> NDArray:
    """A few values, spread evenly."""
    return array.ravel()[np.linspace(0, array.size - 1, min(SAMPLES, array.size)).astype(int)]


def difference(stored: Json, array: NDArray, before: NDArray | None = None) -> str | None:
    """How an array differs from what is stored of it, in words; None if it is the same to the last bit."""
    now = summarise(array)
    if all(now[name] == stored[name] for name in KEPT):
        return None
    if (now["type"], now["shape"]) != (stored["type"], stored["shape"]):
        return f"{stored['type']} {stored['shape']} -> {now['type']} {now['shape']}"
    if before is not None and array.dtype.kind in "biuf":
        gaps = gaps_between(array, before)
        return f"{np.count_nonzero(gaps)} of {gaps.size} values differ, by up to {gaps.max():.3g}"
    if "values" not in stored:
        return "other bytes"
    gap = float(gaps_between(sampled(array), as_floats(stored["values"])).max())
    return f"differs; in the values that are kept by up to {gap:.3g}"


def is_close(stored: Json, array: NDArray) -> bool:
    """Whether an array is the same but for rounding, as far as the kept values tell."""
    if difference(stored, array) is None:
        return True
    if "values" not in stored or (array.dtype.str, list(array.shape)) != (stored["type"], stored["shape"]):
        return False
    before = as_floats(stored["values"])
    return bool(np.allclose(sampled(array), before, rtol=TOLERANCE, atol=TOLERANCE, equal_nan=True))


def as_floats(values: object) -> NDArray[np.float64]:
    """Kept values; None was not a number."""
    assert isinstance(values, list)
    return np.array([np.nan if value is None else value for value in values], np.float64)


def gaps_between(now: NDArray, before: NDArray) -> NDArray[np.float64]:
    """Absolute differences; infinite where only one is a number."""
    a, b = np.atleast_1d(now).astype(np.float64), np.atleast_1d(before).astype(np.float64)
    gaps = np.abs(a - b)
    gaps[np.isnan(a) & np.isnan(b)] = 0.0
    return np.nan_to_num(gaps, nan=np.inf)


def compare(
    stored: Mapping[str, Mapping[str, Json]], found: Mapping[str, Arrays], values: Mapping[str, NDArray]
) -> list[tuple[str, str]]:
    """A row per output: its name, and "equal" or what differs in it."""
    rows = []
    for name, arrays in found.items():
        before = stored.get(name)
        if before is None:
            rows.append((name, "not in the file"))
            continue
        told = [f"{key}: is gone" for key in before if key not in arrays]
        told += [f"{key}: is new" for key in arrays if key not in before]
        for key in arrays:
            if key in before and (words := difference(before[key], arrays[key], values.get(f"{name}|{key}"))):
                told.append(f"{key}: {words}")
        rows.append((name, "equal" if not told else "\n".join(told)))
    return rows
