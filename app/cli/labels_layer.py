"""Which labels a verb is about: of one recording, one camera, one annotator."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from app.cli.arguments import DATA, flag, positional
from app.cli.detect import choose_camera
from app.cli.terminal import json_ready, print_lines, say
from app.modes.label.sources import LabelSource, sources_of
from core.errors import CommandError
from core.recordings import CameraStream, Recording, open_recording
from labels.store import LabelStore, Layer, find_annotators, find_layers

Labelled = CameraStream | LabelSource
"""An event camera, or the frames of an ordinary one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerArguments:
    """Which labels of what."""

    recording: Path = positional("the recording that was labelled", "REC")
    camera: str | None = flag("which camera; needed if there are several", "NAME")
    annotator: str | None = flag("whose labels; needed if there are several", "NAME")
    data: Path = flag("workspace", "DIR", DATA)
    json: bool = flag("print the result as JSON")

    @property
    def folder(self) -> Path:
        """Where the labels are."""
        return self.data / "labels"

    @contextmanager
    def open(self) -> Iterator[tuple[Recording, Labelled]]:
        """The recording and what was labelled of it, until the block ends."""
        with closing(open_recording(self.recording)) as recording:
            frames = sources_of(recording).get(self.camera or "")
            stream = frames if frames is not None and frames.frames is not None else None
            yield recording, stream or choose_camera(recording, self.camera)

    def tell(self, report: dict[str, object], lines: Iterable[str]) -> None:
        """What came out, for a program or a person."""
        if self.json:
            say(json.dumps(json_ready(report)))
        else:
            print_lines(lines)


def read_layers(
    folder: Path, recording: Recording, cameras: Collection[str], annotator: str | None
) -> tuple[LabelStore, ...]:
    """What one annotator said of those cameras, a store for each that has labels.

    Raises:
        CommandError: if there is none, several annotators and no name, or the store is damaged.
    """
    # Who has only begun a layer, as by an import that was refused, has said nothing.
    known = find_annotators(folder, recording.uuid)
    layers = [
        layer
        for layer in find_layers(folder, recording.uuid)
        if layer.camera in cameras and not layer.blind and layer.annotator in known
    ]
    names = sorted({layer.annotator for layer in layers})
    if not names:
        remedy = "label it in the app, or name the folder with --data"
        which = f"{'camera' if len(cameras) == 1 else 'cameras'} {', '.join(map(repr, cameras))}"
        raise CommandError(f"no labels of {which} of this recording", where=folder, remedy=remedy)
    if annotator is None and len(names) > 1:
        raise CommandError("whose labels?", expected=f"--annotator with one of {', '.join(names)}")
    name = annotator or names[0]
    if name not in names:
        raise CommandError(f"no labels by {name!r}", expected=f"one of {', '.join(names)}", where="--annotator")
    return tuple(read_whole(folder, layer) for layer in layers if layer.annotator == name)


def read_whole(folder: Path, layer: Layer) -> LabelStore:
    """A store from which nothing is missing: figures and files of a part of the labels would pass for all of them.

    Raises:
        CommandError: if it is damaged.
        LabelError: if there is none.
    """
    store = LabelStore.read(folder, layer)
    if not store.is_damaged:
        return store
    with store:
        raise CommandError(store.notes[0], remedy=f"rallyscope labels merge {store.path} --out NEW.sqlite saves them")


def check_name(folder: Path, recording: Recording, name: str, where: str) -> None:
    """Raises CommandError if somebody of this name in other letters has labels: the app takes both for one person."""
    for known in find_annotators(folder, recording.uuid):
        if known != name and known.casefold() == name.casefold():
            raise CommandError("a name in other letters", expected=f"{known!r}, who has labels", got=name, where=where)


def read_layer(arguments: LayerArguments, recording: Recording, stream: Labelled) -> LabelStore:
    """The layer that is meant; raises CommandError."""
    (store,) = read_layers(arguments.folder, recording, (stream.name,), arguments.annotator)
    return store
