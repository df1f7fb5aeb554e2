"""A data set of flights that somebody selected: each is cut out of its recording into a file of its own."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Final

import numpy as np

from core.data_sets.card import FORMAT, Json, total_of, total_table
from core.data_sets.facts import RecordingFacts
from core.text import markdown_table

SPLITS: Final = ("training", "validation", "test")
SHARES: Final = (0.7, 0.15, 0.15)
FEWEST_RECORDINGS: Final = 10
"""From so many on a recording is in one split as a whole: its background and cameras are not tested on what was learnt.
Of fewer one of the splits would have next to nothing, so the flights are split."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CutFlight:
    """Where a file of the data set is from, and who says where the ball is in it."""

    recording: str
    """Name of the recording that it is cut out of."""
    recording_uuid: str
    ball: int
    """Number of the ball in the recording, from 1."""
    start_us: int
    """[start_us, end_us) on the clock of the recording."""
    end_us: int
    found_by: str
    """What found the times: truth, prediction or tracker. It says nothing of the centres."""
    centres_by: Mapping[str, str]
    """By camera: `truth`, or `labels of NAME`; a camera of which nobody says where the ball is, is not in it."""
    label_sources: Mapping[str, int]
    """Number of labels used, by `PositionSource`: `accepted` ones were proposed by a detector."""
    speed_mps: float | None = None
    """At its start, where known."""
    sensor: str = ""


def split_flights(flights: Sequence[CutFlight]) -> list[str]:
    """One of `SPLITS` for each; which one does not depend on the order of the flights.

    No flight is in two of them, nor a recording if there are `FEWEST_RECORDINGS`.
    """
    by_recording = splits_by_recording(flights)
    units = [
        one.recording_uuid if by_recording else f"{one.recording_uuid} {one.start_us} {one.end_us}" for one in flights
    ]
    # By a hash: neighbours in time, or in name, do not all come into one split.
    ordered = sorted(set(units), key=lambda unit: hashlib.sha256(unit.encode()).digest())
    edges = np.round(np.cumsum(SHARES) * len(ordered)).astype(int)
    if len(ordered) >= len(SPLITS):
        edges = np.minimum(edges, len(ordered) - np.arange(len(SPLITS))[::-1])  # none of them is empty
    places = np.searchsorted(edges, np.arange(len(ordered)), side="right")
    split_of = {unit: SPLITS[place] for unit, place in zip(ordered, places.tolist(), strict=True)}
    return [split_of[unit] for unit in units]


def splits_by_recording(flights: Iterable[CutFlight]) -> bool:
    """Whether there are recordings enough to keep each in one split."""
    return len({one.recording_uuid for one in flights}) >= FEWEST_RECORDINGS


def flights_manifest(
    title: str,
    selected_by: str,
    flights: Sequence[tuple[CutFlight, RecordingFacts]],
    left_out: Mapping[str, int],
) -> Json:
    """The manifest, readable as that of a simulated data set: what was planned there, is empty here.

    Args:
        title: name of the data set.
        selected_by: the conditions, or the line round points, in words.
        flights: with the facts of their files.
        left_out: numbers by reason.
    """
    cut, facts = [one for one, _ in flights], [one for _, one in flights]
    splits = split_flights(cut)
    recordings = len({one.recording_uuid for one in cut})
    return {
        "format": FORMAT,
        "rallyscope": version("rallyscope"),
        "title": title,
        "description": (
            f"Flights of table tennis balls, cut out of event-camera recordings by rallyscope {version('rallyscope')}: "
            f"one HDF5 file a flight, and an index of one row each. Flights: {len(cut)}. Recordings: {recordings}. "
            f"Selected by: {selected_by}."
        ),
        "seed": 0,
        "planned": len(cut),
        "scenes": [],
        "placements": [],
        "speeds_mps": [],
        "total": total_of(facts),
        "selection": {
            "selected_by": selected_by,
            "split_by": "recording" if splits_by_recording(cut) else "flight",
            "splits": {name: splits.count(name) for name in SPLITS},
            "label_sources": dict(sum((Counter(one.label_sources) for one in cut), Counter())),
            "left_out": dict(left_out),
        },
        "recordings": [
            {
                "file": f"{fact.name}.h5",
                "settings": _settings(one, fact.name),
                **asdict(fact),
                "flight": {"split": split, **asdict(one)},
            }
            for (one, fact), split in zip(flights, splits, strict=True)
        ],
    }


def _settings(flight: CutFlight, name: str) -> Json:
    """What a simulated recording has of its plan, as far as it is known: the index has no empty cells."""
    speeds_mps = [] if flight.speed_mps is None else [flight.speed_mps]
    return {
        "name": name, "scene": "", "placement": "", "speeds_mps": speeds_mps, "robot": False, "seed": 0,
        "sensor": flight.sensor, "noise_hz": None, "physics": "", "scene_changes": {}, "frames": None,
    }  # fmt: skip


LABELS: Final = {
    "recordings": "flights, a file each",
    "seconds": "seconds",
    "bytes": "bytes",
    "events": "events, all cameras",
    "centres_2d": "visible ball centres in the pictures (2D, labels and samples of the truth, all cameras)",
    "points_3d": "true positions of the ball in the world (3D)",
    "points_3d_seen_by_all": "of these, seen by every camera of the recording",
}
"""The totals in the words of the card."""
COLUMNS: Final = (
    "file", "recording", "ball", "from us", "to us", "found by", "split", "centres by", "events", "2D", "3D", "MB",
)  # fmt: skip
FORMATS: Final = ("", "", "", ",", ",", "", "", "", ",", ",", ",", ".1f")


def splits_text(splits: Mapping[str, int]) -> str:
    """The number of flights of each split, as in `6 training, 1 validation`."""
    return ", ".join(f"{count} {name}" for name, count in splits.items())


def flights_card(manifest: Json) -> str:
    """The manifest as Markdown."""
    selection, entries, total = manifest["selection"], manifest["recordings"], manifest["total"]
    assert isinstance(selection, dict) and isinstance(entries, list) and isinstance(total, dict)
    recordings = len({one["flight"]["recording_uuid"] for one in entries})
    lines = [
        f"# Data card: {manifest['title']}",
        "",
        f"Flights cut out of recordings by rallyscope {manifest['rallyscope']}. Flights: {len(entries)}. Recordings: "
        f"{recordings}. Times in a file count from the flight's start.",
        "",
        f"Selected by: {selection['selected_by']}.",
        "",
        f"Split by {selection['split_by']}: {splits_text(selection['splits'])}. No flight is in two splits.",
        "",
        total_table(total, LABELS),
        "Who says where the ball is:",
        "",
        markdown_table(("2D centres by", "flights", "centres or labels"), _sources(entries), ("", ",", ",")),
    ]
    if selection["label_sources"]:
        used = ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in selection["label_sources"].items())
        lines += [f"Labels by how their position came about: {used}. Accepted ones were proposed by a detector.", ""]
    if selection["left_out"]:
        lines += ["Left out:", "", markdown_table(("reason", "number"), selection["left_out"].items(), ("", ","))]
    return "\n".join([*lines, markdown_table(COLUMNS, map(_row, entries), FORMATS)])


def _sources(entries: Sequence[Mapping]) -> list[tuple[str, int, int]]:
    """Who, the flights of which he has a camera or more, and the centres in those cameras."""
    flights: Counter[str] = Counter()
    centres: Counter[str] = Counter()
    for entry in entries:
        by = entry["flight"]["centres_by"]
        flights.update(set(by.values()) or {"3D truth only"})
        for camera, who in by.items():
            centres[who] += entry["cameras"][camera]["centres"]
    return [(who, count, centres[who]) for who, count in sorted(flights.items())]


def _row(entry: Mapping) -> tuple[object, ...]:
    flight, cameras = entry["flight"], entry["cameras"].values()
    by = "; ".join(f"{camera}: {who}" for camera, who in flight["centres_by"].items()) or "-"
    return (
        entry["file"], flight["recording"], flight["ball"], flight["start_us"], flight["end_us"], flight["found_by"],
        flight["split"], by, sum(one["events"] for one in cameras), sum(one["centres"] for one in cameras),
        entry["points_3d"], entry["bytes"] / 1e6,
    )  # fmt: skip
