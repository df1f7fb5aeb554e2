"""Outputs of any kind as named arrays, files of them, and how an array differs from an earlier one."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import h5py
import numpy as np
from numpy.typing import NDArray

NUMBER: Final = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")

Arrays = dict[str, NDArray]
Json = dict[str, object]


@dataclass(frozen=True, slots=True)
class Tolerance:
    """What another processor may round otherwise. Integers and bytes are compared exactly, but for `share`."""

    atol: float = 1e-6
    rtol: float = 1e-6
    share: float = 0.0
    """Of the values of an array, as many may be anything: pixels on an edge."""


EXACT: Final = Tolerance(0.0, 0.0)


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


def difference(before: NDArray, now: NDArray, tolerance: Tolerance) -> str | None:
    """How an array differs from an earlier one, in words; None if it is the same within a tolerance."""
    if (now.dtype.str, now.shape) != (before.dtype.str, before.shape):
        return f"{before.dtype.str} {list(before.shape)} -> {now.dtype.str} {list(now.shape)}"
    if now.dtype.kind not in "biuf":
        return None if np.array_equal(now, before) else "other values"
    gaps = gaps_between(now, before)
    allowed = tolerance.atol + tolerance.rtol * np.abs(np.nan_to_num(before)) if now.dtype.kind == "f" else 0.0
    off = np.count_nonzero(gaps > allowed)
    if off <= tolerance.share * gaps.size:
        return None
    return f"{off} of {gaps.size} values differ, by up to {gaps.max():.3g}"


def gaps_between(now: NDArray, before: NDArray) -> NDArray[np.float64]:
    """Absolute differences; infinite where only one is a number."""
    a, b = now.astype(np.float64), before.astype(np.float64)
    with np.errstate(invalid="ignore"):
        gaps = np.where(a == b, 0.0, np.abs(a - b))  # two infinities are the same
    return np.where(np.isnan(a) & np.isnan(b), 0.0, np.nan_to_num(gaps, nan=np.inf))


def differences(before: Arrays, now: Arrays, tolerance: Tolerance) -> list[str]:
    """What is gone, new or different in an output, a line each."""
    found = [f"{key}: is gone" for key in before if key not in now]
    found += [f"{key}: is new" for key in now if key not in before]
    for key in now:
        if key in before and (words := difference(before[key], now[key], tolerance)):
            found.append(f"{key}: {words}")
    return found


def write_outputs(path: Path, outputs: Mapping[str, Arrays], machine: Mapping[str, object]) -> None:
    """All arrays of all outputs in one file, and where they were computed."""
    flat = {f"{name}|{key}": array for name, arrays in outputs.items() for key, array in arrays.items()}
    np.savez_compressed(path, machine=np.array(json.dumps(machine)), **flat)  # type: ignore[arg-type]


def read_outputs(path: Path) -> tuple[dict[str, Arrays], Json]:
    """What `write_outputs` wrote."""
    outputs: dict[str, Arrays] = {}
    with np.load(path) as file:
        for name in file.files:
            output, bar, key = name.partition("|")
            if bar:
                outputs.setdefault(output, {})[key] = file[name]
        return outputs, json.loads(str(file["machine"]))
