"""Damage that knows HDF5: every dataset, attribute and group of a file missing, cut, of another type, or a link."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import h5py
import numpy as np
from numpy.typing import NDArray

ELSEWHERE: Final = "elsewhere.h5"
"""The file beside the damaged one that its links lead to: nothing of it may ever be read."""
RUBBISH: Final[tuple[object, ...]] = (
    "", "nan", "ball", "[]", "{", "\u00e9" * 300, -1, 0, 1, 2**31, 2**63 - 1, -(2**63), 2**64 - 1, 1.5, np.nan, np.inf,
    -np.inf, 1e300, True, b"\xff\xfe", np.zeros(0), np.zeros(3), np.zeros((2, 2)), np.array([b"a", b"b"], "S1"),
    np.array([(1, 2.0)], [("a", "i4"), ("b", "f8")]), 1 + 2j, h5py.Empty("f8"), h5py.Empty("S4"), "../../x", "a/b",
)  # fmt: skip
TYPES: Final = ("i1", "u1", "i2", "u4", "i8", "u8", "f2", "f4", "f8", ">i8", ">f8", "c16", "S3", "?")
MAX_VALUES: Final = 10_000_000
"""More of them are not read to be damaged."""
VALUES: Final = (np.nan, np.inf, -np.inf, -1, 0, 1e300, 2**31, 2**62, -(2**62), 2.0**63, 255, 65535, 1e-300)


def damage_hdf5(file: h5py.File, rng: np.random.Generator) -> str:
    """Damage one thing in an open file, or now and then several; what was done to what."""
    done = [_damage_once(file, rng) for _ in range(1 if rng.random() < 0.8 else int(rng.integers(2, 5)))]
    return "; ".join(done)


def _damage_once(file: h5py.File, rng: np.random.Generator) -> str:
    names: list[str] = []
    file.visit(names.append)
    places = ["/", *sorted(names)]
    with_attributes = [place for place in places if place in file and len(file[place].attrs)]
    if rng.random() < 0.3 and with_attributes:
        holder = file[_choice(with_attributes, rng)]
        assert isinstance(holder, h5py.Group)
        return _damage_attribute(holder, _choice(sorted(map(str, holder.attrs)), rng), rng)
    name = str(_choice(places[1:] or places, rng))
    item = file.get(name)
    if isinstance(item, h5py.Dataset) and rng.random() < 0.75:
        act = ARRAY_ACTS[int(rng.integers(len(ARRAY_ACTS)))]
        return _damage_array(item, act, rng)
    if name == "/" or item is None:
        return "nothing"
    return _damage_link(file, name, rng)


def _choice(items: list[str], rng: np.random.Generator) -> str:
    return items[int(rng.integers(len(items)))]


def _damage_attribute(item: h5py.Group, name: str, rng: np.random.Generator) -> str:
    if rng.random() < 0.3:
        del item.attrs[name]
        return f"{item.name}@{name} removed"
    value = RUBBISH[int(rng.integers(len(RUBBISH)))]
    try:
        item.attrs[name] = value
    except (TypeError, ValueError, OverflowError, OSError):
        item.attrs[name] = repr(value)
    return f"{item.name}@{name} = {str(value)[:30]!r}"


def _damage_array(item: h5py.Dataset, act: ArrayAct, rng: np.random.Generator) -> str:
    if item.size and item.size > MAX_VALUES:  # a damage before this one made it so
        return f"{item.name}: stays absurdly long"
    file, name, values = item.file, str(item.name), np.asarray(item[()])
    what = act.__name__.strip("_").replace("_", " ")
    if act is _absurdly_long:
        del file[name]
        shape = (int(10 ** rng.integers(6, 16)), *values.shape[1:])
        file.create_dataset(name, shape, values.dtype, chunks=(1024, *values.shape[1:]), compression="gzip")
        return f"{name}: {what} {shape[0]}"
    try:
        with np.errstate(all="ignore"):
            changed = act(values, rng)
    except (TypeError, ValueError, IndexError, OverflowError):
        changed = values[:0] if values.ndim else np.zeros(0)
    same = values.dtype == changed.dtype and values.ndim == changed.ndim and values.shape[1:] == changed.shape[1:]
    options = {}
    if values.ndim and rng.random() < 0.7 and changed.size and item.chunks and same:
        options = {"chunks": item.chunks, "compression": "gzip", "shuffle": True, "maxshape": (None, *values.shape[1:])}
    del file[name]
    try:
        file.create_dataset(name, data=changed, **options)
    except (TypeError, ValueError):
        file[name] = changed
    return f"{name}: {what} ({changed.dtype}{changed.shape})"


ArrayAct = Callable[[NDArray, np.random.Generator], NDArray]


def _cut(values: NDArray, rng: np.random.Generator) -> NDArray:
    return values[: int(rng.integers(len(values)))]


def _longer(values: NDArray, rng: np.random.Generator) -> NDArray:
    return np.concatenate([values, values[: int(rng.integers(1, len(values) + 1))]])


def _reversed(values: NDArray, rng: np.random.Generator) -> NDArray:
    return values[::-1]


def _shuffled(values: NDArray, rng: np.random.Generator) -> NDArray:
    return rng.permutation(values)


def _emptied(values: NDArray, rng: np.random.Generator) -> NDArray:
    return values[:0]


def _another_type(values: NDArray, rng: np.random.Generator) -> NDArray:
    return values.astype(TYPES[int(rng.integers(len(TYPES)))])


def _another_shape(values: NDArray, rng: np.random.Generator) -> NDArray:
    shapes = ((-1, 1), (1, -1), (-1,), (1, 1, -1))
    return values.reshape(shapes[int(rng.integers(len(shapes)))])


def _scalar(values: NDArray, rng: np.random.Generator) -> NDArray:
    return np.asarray(values.flat[0])


def _compound(values: NDArray, rng: np.random.Generator) -> NDArray:
    mixed = np.zeros(values.shape, [("a", values.dtype), ("b", "S4")])
    mixed["a"] = values
    return mixed


def _one_value(values: NDArray, rng: np.random.Generator) -> NDArray:
    """A few values, or all of them, absurd."""
    value = VALUES[int(rng.integers(len(VALUES)))]
    kind = values.dtype if values.dtype.kind in "fiu" and rng.random() < 0.7 else np.dtype(np.float64)
    changed = values.astype(kind)
    if kind.kind != "f":
        info = np.iinfo(kind.name)
        value = 0 if np.isnan(value) else int(min(max(value, info.min), info.max))
    where = slice(None) if rng.random() < 0.2 else rng.integers(0, changed.size, 3)
    changed.reshape(-1)[where] = value
    return changed


def _noise(values: NDArray, rng: np.random.Generator) -> NDArray:
    return np.frombuffer(rng.bytes(values.nbytes), values.dtype).reshape(values.shape)


def _words(values: NDArray, rng: np.random.Generator) -> NDArray:
    return np.full(values.shape, b"ball", "S4")


def _absurdly_long(values: NDArray, rng: np.random.Generator) -> NDArray:
    return values


ARRAY_ACTS: Final[tuple[ArrayAct, ...]] = (
    _cut, _longer, _reversed, _shuffled, _emptied, _another_type, _another_shape, _scalar, _compound, _one_value,
    _one_value, _noise, _words, _absurdly_long,
)  # fmt: skip


def _damage_link(file: h5py.File, name: str, rng: np.random.Generator) -> str:
    kind = int(rng.integers(8))
    item = file[name]
    is_dataset = isinstance(item, h5py.Dataset)
    shape, dtype = (item.shape, item.dtype) if isinstance(item, h5py.Dataset) else ((), np.dtype("f8"))
    del file[name]
    match kind:
        case 0 | 1:
            return f"{name} removed"
        case 2:
            file[name] = h5py.SoftLink("/nowhere" if rng.random() < 0.5 else f"/{name}")
            return f"{name} a soft link"
        case 3:
            file[name] = h5py.ExternalLink(ELSEWHERE, f"/{name}")
            return f"{name} an external link"
        case 4:
            if is_dataset:
                file.create_group(name)
            else:
                file[name] = np.zeros(4)
            return f"{name} a {'group' if is_dataset else 'dataset'}"
        case 5:
            file[name] = file["/"]
            return f"{name} a link to the root"
        case 6 if shape and shape[0]:
            file.create_dataset(name, shape, dtype, external=[(ELSEWHERE, 0, h5py.h5f.UNLIMITED)])
            return f"{name} with its data in another file"
        case 7 if shape and shape[0]:
            layout = h5py.VirtualLayout(shape, dtype)  # type: ignore[call-overload]
            layout[...] = h5py.VirtualSource(ELSEWHERE, name, shape)
            file.create_virtual_dataset(name, layout)
            return f"{name} a view of another file"
        case _:
            file[name] = np.dtype("f8")
            return f"{name} a named type"
