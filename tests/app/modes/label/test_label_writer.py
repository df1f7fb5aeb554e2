"""The thread that writes labels, and the log of the store beside its file."""

import shutil
import time

from app.modes.label.label_writer import IDLE_S, LabelWriter
from labels.model import Label, LabelState
from labels.store import LabelStore, Layer
from labels.store_registry import LabelStoreRegistry
from tests.waiting import eventually

LAYER = Layer("9f3c-1", "left", "anna")


def put_label(store: LabelStore) -> tuple[int, ...]:
    store.put(Label(t_us=1, state=LabelState.NO_BALL))
    return (1,)


def test_after_a_rest_the_file_alone_holds_what_was_written(tmp_path) -> None:
    registry = LabelStoreRegistry(tmp_path / "labels")
    writer, saved, seen = LabelWriter(registry, "a"), [], []
    store_file, copy = LAYER.path(tmp_path / "labels"), LAYER.path(tmp_path / "copy")

    writer.write(LAYER, put_label, saved.append, saved.append)
    eventually(lambda: saved and not writer.waiting, "the answer")
    writer.checkpoint_when_idle(time.monotonic() + 2 * IDLE_S)
    writer.look(LAYER, seen.append, seen.append)  # in its turn: after the log was copied
    eventually(lambda: seen, "the log to be copied into the file")
    beside = {f"{store_file.name}-wal", f"{store_file.name}-shm"}
    shutil.copytree(store_file.parent, copy.parent, ignore=lambda *_: beside)
    assert LabelStore.read(tmp_path / "copy", LAYER).labels().t_us.tolist() == [1]
    writer.close()


def test_labels_that_were_looked_at_can_be_read_until_those_of_a_change_are_taken_up(tmp_path) -> None:
    with LabelStore.open(tmp_path, LAYER.recording_uuid, LAYER.camera, LAYER.annotator) as store:
        store.put(Label(t_us=2, state=LabelState.NO_BALL))
    writer, seen, saved = LabelWriter(LabelStoreRegistry(tmp_path), "a"), [], []
    writer.look(LAYER, seen.append, seen.append)
    writer.write(LAYER, put_label, saved.append, saved.append)
    eventually(lambda: saved, "the answer")
    assert seen[0].labels[2].state is LabelState.NO_BALL and sorted(saved[0].labels) == [1, 2]
    writer.close()
