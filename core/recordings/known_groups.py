"""The columns of every group of rows that the project knows: a group of another making is not taken for one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError


@dataclass(frozen=True, slots=True)
class ColumnKind:
    """What a column holds."""

    kinds: str
    """Of `numpy.dtype.kind`."""
    row_shape: tuple[int, ...] = ()
    required: bool = True


WHOLE: Final = ColumnKind("iu")
REAL: Final = ColumnKind("fiu")
FLAG: Final = ColumnKind("biu")
TEXT: Final = ColumnKind("S")
VECTOR: Final = ColumnKind("fiu", (3,))
TURN: Final = ColumnKind("fiu", (4,))
_MAYBE: Final = {width: ColumnKind("fiu", (width,), required=False) for width in (2, 3, 4, 6)}

Columns = Mapping[str, ColumnKind]
_POSE: Final[Columns] = {"t_us": WHOLE, "p_world_m": VECTOR, "q_world_wxyz": TURN}
_PIXEL_TRUTH: Final[Columns] = {"t_us": WHOLE, "u_px": REAL, "v_px": REAL, "r_px": REAL, "visible": FLAG}
_TRIGGERS: Final[Columns] = {"t": WHOLE, "p": FLAG, "id": WHOLE}
_READOUT: Final[Columns] = {"delayed": WHOLE, "dropped": WHOLE, "longest_us": WHOLE}
_EXACTLY: Final[Mapping[str, Columns]] = {
    "/ground_truth/ball": {
        "t_us": WHOLE,
        "p_world_m": VECTOR,
        "v_world_mps": VECTOR,
        "spin_radps": VECTOR,
        "visible": FLAG,
    },
    "/racket": {**_POSE, "v_world_mps": _MAYBE[3]},
    "/predictions": {
        "t_us": WHOLE,
        "stage": TEXT,
        "t_hit_us": WHOLE,
        "p_hit_m": VECTOR,
        "v_hit_mps": VECTOR,
        "cov": ColumnKind("fiu", (6, 6)),
    },
    "/racket_targets": {
        **_POSE,
        "stage": TEXT,
        "t_hit_us": WHOLE,
        "v_world_mps": VECTOR,
        "a": VECTOR,
        "g": ColumnKind("fiu", (2,)),
    },
    "/episodes": {
        "serve_us": WHOLE,
        "speed_mps": REAL,
        "case": WHOLE,
        "f": VECTOR,
        "s": _MAYBE[6],
        "g": _MAYBE[2],
        "a": _MAYBE[3],
        "q_wxyz": _MAYBE[4],
        "s_next": _MAYBE[6],
    },
    "/scenes": {"t_us": WHOLE, "zero_us": WHOLE, "seed": WHOLE, "name": TEXT},
}


def check_known_rows(group: str, rows: Mapping[str, NDArray]) -> None:
    """Check the columns of a group that the project knows; of any other nothing is asked.

    Raises:
        RecordingError: if a column is missing, holds something else, or times run backwards or are absurd.
    """
    for name, kind in _columns_of(group).items():
        column = rows.get(name)
        if column is None:
            if kind.required:
                raise RecordingError(f"column {name} is missing", where=group)
            continue
        if column.dtype.kind not in kind.kinds or column.shape[1:] != kind.row_shape:
            expected, got = f"rows of shape {kind.row_shape}, type {kind.kinds}", f"{column.dtype}{column.shape}"
            raise RecordingError(f"column {name} holds something else", expected=expected, got=got, where=group)
        if name in ("t", "t_us", "serve_us", "t_hit_us", "zero_us", "seed") and column.dtype.kind in "iu":
            _check_whole(name, column, group)


def _columns_of(group: str) -> Columns:
    parts = group.strip("/").split("/")
    if group in _EXACTLY:
        return _EXACTLY[group]
    if len(parts) == 2 and parts[0] in ("ground_truth", "readout"):
        return _PIXEL_TRUTH if parts[0] == "ground_truth" else _READOUT
    return _TRIGGERS if len(parts) == 3 and (parts[0], parts[2]) == ("cameras", "triggers") else {}


def _check_whole(name: str, column: NDArray, group: str) -> None:
    """Times are within ten years, and those of the rows themselves never decrease; a seed is not negative."""
    largest = 2**63 - 1 if name == "seed" else 315_576_000 * 1_000_000
    smallest = 0 if name == "seed" else -largest
    if len(column) and not smallest <= int(column.min()) <= int(column.max()) <= largest:
        got = f"{column.min()} to {column.max()}"
        raise RecordingError(
            f"column {name} is out of range", expected=f"{smallest} to {largest}", got=got, where=group
        )
    if name in ("t", "t_us") and bool(np.any(column[1:] < column[:-1])):
        raise RecordingError(f"column {name} runs backwards", expected="times that never decrease", where=group)
