"""A set of recordings of one's own: what there is, who labelled what, and how those labels came about."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from core.errors import CommandError
from core.recordings import open_recording
from labels.arrays import STATES, LabelArrays
from labels.model import LabelState, PositionSource
from labels.score import GROUPS
from labels.store import LabelStore, Layer, find_layers


@dataclass(frozen=True, slots=True, eq=False)
class LabelledLayer:
    """What one annotator said of one camera of one recording."""

    path: Path
    camera: str
    annotator: str
    blind: bool
    """Second looks, made without seeing the first."""
    labels: LabelArrays
    proposed_by: Mapping[str, int]
    """How many labels are accepted proposals, by the detector that made them."""

    @property
    def asked(self) -> LabelArrays:
        """Those that a detector is asked about: all but occluded balls."""
        return self.labels.rows(self.labels.state != STATES.index(LabelState.OCCLUDED))


@dataclass(frozen=True, slots=True)
class RecordingCard:
    """One recording of the set, as its file says."""

    recording: str
    uuid: str
    seconds: float
    cameras: tuple[str, ...]
    """Name, width and height in pixels, and whether it is calibrated."""
    events: int
    notes: tuple[str, ...]
    labels: int
    """Of all annotators, without second looks."""


@dataclass(frozen=True, slots=True, eq=False)
class OwnSet:
    """All of it."""

    recordings: tuple[RecordingCard, ...]
    layers: tuple[LabelledLayer, ...]
    """By recording, camera and annotator, second looks last; none without labels."""

    @property
    def annotators(self) -> tuple[str, ...]:
        """Who labelled, by name."""
        return tuple(sorted({layer.annotator for layer in self.first_looks()}))

    def first_looks(self, annotator: str | None = None) -> list[LabelledLayer]:
        """The layers that a detector is scored against, of one annotator if there is a name."""
        return [one for one in self.layers if not one.blind and annotator in (None, one.annotator)]


def own_recordings(place: str) -> tuple[Path, ...]:
    """The file, or the recordings of the folder: those whose names end in `.h5`.

    Raises:
        CommandError: if there is no such place, or nothing in it.
    """
    path = Path(place)
    found = tuple(sorted(path.glob("*.h5"))) if path.is_dir() else (path,) if path.is_file() else ()
    if not found:
        raise CommandError("no recordings", expected="a recording, or a folder of .h5 files", where=place)
    return found


def read_own_set(paths: Sequence[Path], folder: Path, annotator: str | None = None) -> OwnSet:
    """The recordings and the labels of them in a folder of labels, of one annotator if there is a name.

    Raises:
        CommandError: if a recording is there twice, or there are no labels, or none by that annotator.
        RecordingError: if a recording cannot be read.
        LabelError: if a store cannot be read.
    """
    cards: list[RecordingCard] = []
    layers: list[LabelledLayer] = []
    names: set[str] = set()
    of_uuid: dict[str, Path] = {}
    for path in paths:
        with open_recording(path) as recording:
            if recording.uuid in of_uuid:
                same = f"{of_uuid[recording.uuid].name} and {path.name}"
                raise CommandError("the same recording twice", got=same, remedy="take one of them away")
            of_uuid[recording.uuid] = path
            found = [layer for layer in find_layers(folder, recording.uuid) if layer.camera in recording.cameras]
            read = [one for one in (_read_layer(path, folder, layer) for layer in found) if len(one.labels)]
            names |= {layer.annotator for layer in read}
            mine = [one for one in read if annotator in (None, one.annotator)]
            layers += sorted(mine, key=lambda one: one.blind)
            cameras = [
                f"{name} {stream.sensor.width_px}x{stream.sensor.height_px}"
                f"{'' if stream.calibration is None else ', calibrated'}"
                for name, stream in recording.cameras.items()
            ]
            events = sum(stream.event_count for stream in recording.cameras.values())
            counted = sum(len(one.labels) for one in mine if not one.blind)
            seconds = 1e-6 * recording.duration_us
            card = RecordingCard(
                path.name, recording.uuid, seconds, tuple(cameras), events, tuple(recording.notes), counted
            )
            cards.append(card)
    own = OwnSet(tuple(cards), tuple(layers))
    if annotator is not None and names and annotator not in names:
        expected = f"one of {', '.join(sorted(names))}"
        raise CommandError(f"no labels by {annotator!r}", expected=expected, where="--annotator")
    if not own.first_looks():
        remedy = "label some in the app, or name the workspace with --data"
        raise CommandError("no labels of these recordings", got=f"{len(cards)} recordings", where=folder, remedy=remedy)
    return own


def _read_layer(path: Path, folder: Path, layer: Layer) -> LabelledLayer:
    store = LabelStore.read(folder, layer)
    accepted = [one for one in store.all() if one.provenance.source is PositionSource.ACCEPTED]
    by = Counter(one.provenance.detector or "a detector that is not named" for one in accepted)
    return LabelledLayer(path, layer.camera, layer.annotator, layer.blind, store.labels(), by)


def count_by_source(layers: Iterable[LabelledLayer]) -> dict[str, int]:
    """How many labels came about in which way, in the words of `labels.score.GROUPS`; only those that there are."""
    columns = [layer.labels.source.tolist() for layer in layers]
    sources = Counter(tuple(PositionSource)[source] for column in columns for source in column)
    counts = {name: sum(sources[one] for one in group) for name, group in GROUPS.items() if name != "all"}
    return {name: count for name, count in counts.items() if count}


def count_by_state(layers: Iterable[LabelledLayer]) -> dict[str, int]:
    """How many labels say what; only those that there are."""
    states = Counter(STATES[state].value for layer in layers for state in layer.labels.state.tolist())
    return {state.value: states[state.value] for state in STATES if states[state.value]}
