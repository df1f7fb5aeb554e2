"""The thread that writes labels, and the log of the store beside its file."""

import shutil
import time

from app.modes.label.label_writer import IDLE_S, LabelWriter
from labels.model import Label, LabelState
from labels.store import LabelStore, Layer
from labels.store_registry import LabelStoreRegistry
from tests.waiting import eventually

LAYER = Layer("9f3c-1", "left", "anna")


def test_after_a_rest_the_file_alone_holds_what_was_written(tmp_path) -> None:
    registry = LabelStoreRegistry(tmp_path / "labels")
    writer, saved = LabelWriter(registry, "a"), []
    store_file, copy = LAYER.path(tmp_path / "labels"), LAYER.path(tmp_path / "copy")

    def put(store: LabelStore) -> tuple[int, ...]:
        store.put(Label(t_us=1, state=LabelState.NO_BALL))
        return (1,)

    def is_whole() -> bool:
        writer.checkpoint_when_idle(time.monotonic() + 2 * IDLE_S)
        shutil.copytree(
            store_file.parent,
            copy.parent,
            dirs_exist_ok=True,
            ignore=lambda *_: {f"{store_file.name}-wal", f"{store_file.name}-shm"},
        )
        return copy.stat().st_size > 4096 and LabelStore.read(tmp_path / "copy", LAYER).labels().t_us.tolist() == [1]

    writer.write(LAYER, put, saved.append, saved.append)
    eventually(lambda: saved, "the answer")
    eventually(is_whole, "the log to be copied into the file")
    writer.close()
