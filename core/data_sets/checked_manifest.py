"""Whether a manifest of a data set has what its readers ask for; files get damaged, or edited by hand."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from core.errors import RecordingError

Kinds = Mapping[str, type | tuple[type, ...]]
LARGEST: Final = 1e20
"""More than any seed, which has 64 bits."""
NUMBER: Final = (int, float)
TOTALS: Final = (
    "recordings", "seconds", "bytes", "events", "centres_2d", "points_3d", "points_3d_seen_by_all", "frames",
    "frames_with_ball", "episodes", "returned", "racket_poses", "delayed_by_readout", "dropped_by_readout",
)  # fmt: skip
TOP: Final[Kinds] = {
    "rallyscope": str, "title": str, "seed": int, "planned": int, "scenes": list, "placements": list,
    "speeds_mps": list, "total": dict, "recordings": list,
}  # fmt: skip
ENTRY: Final[Kinds] = {
    "file": str, "settings": dict, "cameras": dict, "duration_us": int, "points_3d": int, "bytes": int,
}  # fmt: skip
SETTINGS: Final[Kinds] = {"scene": str, "placement": str, "speeds_mps": list, "robot": bool, "seed": int}
CAMERA: Final[Kinds] = dict.fromkeys(("events", "centres", "frames", "frames_with_ball", "dropped"), int)


def check_manifest(manifest: Mapping[str, object], path: Path) -> None:
    """Check what is read of a manifest.

    Raises:
        RecordingError: naming the file, the place in it, and what is wrong there.
    """
    _check(manifest, TOP, str(path))
    _check(manifest["total"], dict.fromkeys(TOTALS, NUMBER), f"{path}: total")
    entries = manifest["recordings"]
    assert isinstance(entries, list)
    for number, entry in enumerate(entries):
        where = f"{path}: recordings[{number}]"
        _check(entry, ENTRY, where)
        _check(entry["settings"], SETTINGS, f"{where}.settings")
        for name, camera in entry["cameras"].items():
            _check(camera, CAMERA, f"{where}.cameras.{name[:40]}")


def _check(values: object, kinds: Kinds, where: str) -> None:
    if not isinstance(values, dict):
        raise RecordingError("not a table of values", got=type(values).__name__, where=where)
    for name, kind in kinds.items():
        if name not in values:
            raise RecordingError(f"{name} is missing", where=where, remedy="make the manifest again: simulate --out")
        value = values[name]
        wrong = not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool)
        if wrong or (isinstance(value, int | float) and not abs(value) < LARGEST):
            raise RecordingError(f"{name} is damaged", got=f"{value!r:.60}", where=where)
        if isinstance(value, list) and name != "recordings":
            _check_list(name, value, where)


def _check_list(name: str, values: list[object], where: str) -> None:
    kind = NUMBER if name == "speeds_mps" else str
    if not all(isinstance(value, kind) and not isinstance(value, bool) for value in values):
        raise RecordingError(f"{name} is damaged", got=f"{values!r:.60}", where=where)
