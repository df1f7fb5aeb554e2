"""The data card: what a data set holds, as JSON for programs and as Markdown for people."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Final

from core.data_sets.facts import RecordingFacts
from core.data_sets.plan import DataSetPlan, PlannedRecording
from core.errors import RecordingError
from core.files import replace_file
from core.text import markdown_table, parse_json

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


MANIFEST: Final = "manifest.json"
CARD: Final = "CARD.md"
FORMAT: Final = "rallyscope-data-set"

Json = dict[str, object]


def write_card(folder: Path, plan: DataSetPlan, facts: Mapping[str, RecordingFacts]) -> Json:
    """Write manifest, cards and index of the recordings that are there; returns the manifest."""
    manifest = make_manifest(plan, facts)
    write_documents(folder, manifest, make_card(manifest))
    return manifest


def write_documents(folder: Path, manifest: Json, card: str) -> None:
    """Write a manifest, its card as Markdown, and the index and the Croissant card that follow from it."""
    from core.data_sets.croissant import write_croissant  # late: pyarrow may not be installed
    from core.data_sets.index import write_index

    for name, text in ((MANIFEST, json.dumps(manifest, indent=2) + "\n"), (CARD, card)):
        replace_file(folder / name, text.encode(), durable=True)
    write_index(folder, manifest)
    write_croissant(folder, manifest)


def read_manifest(folder: Path) -> Json:
    """The manifest of a data set.

    Raises:
        RecordingError: if there is none, or it is damaged.
    """
    path = folder / MANIFEST
    try:
        manifest = parse_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RecordingError("not a data set", expected=f"a folder with {MANIFEST}", where=path) from error
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise RecordingError("not a manifest of a data set", where=path)
    check_manifest(manifest, path)
    return manifest


def make_manifest(plan: DataSetPlan, facts: Mapping[str, RecordingFacts]) -> Json:
    """Totals first, then every recording with its settings. It does not depend on the order in which they were made."""
    there = [planned for planned in plan.recordings if planned.name in facts]
    return {
        "format": FORMAT,
        "rallyscope": version("rallyscope"),
        "title": plan.title,
        "seed": plan.seed,
        "planned": len(plan.recordings),
        "scenes": _in_order(planned.scene for planned in plan.recordings),
        "placements": _in_order(planned.placement for planned in plan.recordings),
        "speeds_mps": sorted({speed for planned in plan.recordings for speed in planned.speeds_mps}),
        "total": total_of([facts[planned.name] for planned in there]),
        "recordings": [_entry(planned, facts[planned.name]) for planned in there],
    }


def _in_order(values: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(values))


def _entry(planned: PlannedRecording, facts: RecordingFacts) -> Json:
    return {"file": f"{planned.name}.h5", "settings": planned.settings, **dataclasses.asdict(facts)}


def total_of(facts: Sequence[RecordingFacts]) -> Json:
    """The sums over all recordings, see `TOTALS`."""
    cameras = [camera for each in facts for camera in each.cameras.values()]
    return {
        "recordings": len(facts),
        "seconds": sum(each.duration_us for each in facts) / 1e6,
        "bytes": sum(each.bytes for each in facts),
        "events": sum(camera.events for camera in cameras),
        "centres_2d": sum(camera.centres for camera in cameras),
        "points_3d": sum(each.points_3d for each in facts),
        "points_3d_seen_by_all": sum(each.points_3d_seen for each in facts),
        "frames": sum(camera.frames for camera in cameras),
        "frames_with_ball": sum(camera.frames_with_ball for camera in cameras),
        "episodes": sum(each.episodes for each in facts),
        "returned": sum(each.returned for each in facts),
        "racket_poses": sum(each.racket_poses for each in facts),
        "delayed_by_readout": sum(camera.delayed for camera in cameras),
        "dropped_by_readout": sum(camera.dropped for camera in cameras),
    }


LABELS: Final = {
    "recordings": "recordings",
    "seconds": "seconds",
    "bytes": "bytes",
    "events": "events, all cameras",
    "centres_2d": "visible ball centres in the pictures (2D, every 0.5 ms, all cameras)",
    "points_3d": "positions of the ball in the world (3D, every 0.5 ms)",
    "points_3d_seen_by_all": "of these, seen by every camera of the recording",
    "frames": "RGB frames, all cameras",
    "frames_with_ball": "of these, with a visible ball (2D truth)",
    "episodes": "serves played by the robot",
    "returned": "of these, returned",
    "racket_poses": "racket poses",
    "delayed_by_readout": "events that the readout delayed",
    "dropped_by_readout": "events that the readout dropped",
}
"""The totals in the words of the card."""


COLUMNS: Final = (
    "recording", "scene", "placement", "m/s", "robot", "s", "events", "2D", "3D", "frames", "with ball", "dropped",
    "MB", "seed",
)  # fmt: skip
FORMATS: Final = ("", "", "", "", "", ".2f", ",", ",", ",", ",", ",", ",", ".1f", "d")
"""Number formats of the card's second table."""


def make_card(manifest: Mapping[str, object]) -> str:
    """The manifest as Markdown."""
    total, recordings = manifest["total"], manifest["recordings"]
    assert isinstance(total, dict) and isinstance(recordings, list)
    lines = [
        f"# Data card: {manifest['title']}",
        "",
        f"Simulated by rallyscope {manifest['rallyscope']}, seed {manifest['seed']}. "
        f"{total['recordings']} of {manifest['planned']} recordings are here. "
        f"Scenes: {_list(manifest['scenes'])}. Placements: {_list(manifest['placements'])}. "
        f"Speeds: {_list(manifest['speeds_mps'])} m/s.",
        "",
        total_table(total),
        markdown_table(COLUMNS, map(_row, recordings), FORMATS),
    ]
    return "\n".join(lines)


def total_table(total: Mapping[str, object], labels: Mapping[str, str] = LABELS) -> str:
    """The sums that have a label in words, as Markdown."""
    return markdown_table(("total", ""), [(label, _figure(total[key])) for key, label in labels.items()])


def _row(entry: Mapping) -> tuple[object, ...]:
    settings, cameras = entry["settings"], entry["cameras"].values()
    sums = {
        key: sum(camera[key] for camera in cameras)
        for key in ("events", "centres", "frames", "frames_with_ball", "dropped")
    }
    return (
        entry["file"],
        settings["scene"],
        settings["placement"],
        _list(settings["speeds_mps"]),
        "plays" if settings["robot"] else "none",
        entry["duration_us"] / 1e6,
        sums["events"],
        sums["centres"],
        entry["points_3d"],
        sums["frames"],
        sums["frames_with_ball"],
        sums["dropped"],
        entry["bytes"] / 1e6,
        settings["seed"],
    )


def _list(values: object) -> str:
    assert isinstance(values, list)
    return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values)


def _figure(value: object) -> str:
    return f"{value:,.2f}" if isinstance(value, float) else f"{value:,}"
