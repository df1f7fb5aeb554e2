from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from core.errors import LabelError
from labels.model import Label, LabelState, PositionSource, Provenance
from labels.records import pack_line
from labels.store import LabelStore, Layer, find_layers
from labels.store_registry import LabelStoreRegistry

UUID = "9f3c-1"


def ball(t_us: int, x: float = 10.0, y: float = 20.0, state: LabelState = LabelState.VISIBLE) -> Label:
    return Label(t_us=t_us, state=state, x_px=x, y_px=y)


def open_store(folder: Path, annotator: str = "anna") -> LabelStore:
    return LabelStore.open(folder, UUID, "left", annotator)


def test_labels_are_there_after_a_restart_to_the_last_bit(tmp_path: Path) -> None:
    label = Label(
        t_us=123_456_789,
        state=LabelState.PARTLY_OCCLUDED,
        x_px=0.1 + 0.2,
        y_px=-1 / 3,
        r_px=7.25,
        covariance_px2=(0.01, 0.002, 0.02),
        provenance=Provenance(
            source=PositionSource.CORRECTED,
            annotator="Åsa",
            made_at_us=5,
            tool="t 1",
            detector="auto#12",
            window_us=(123_455_000, 123_457_000),
            rendering="polarity",
            time_spent_ms=1234,
        ),
    )
    with open_store(tmp_path) as store:
        store.put(label)
        assert store.at(label.t_us) == label
    with open_store(tmp_path) as store:
        assert store.all() == (label,)


def test_the_store_says_who_made_a_label_and_when(tmp_path: Path) -> None:
    with LabelStore.open(tmp_path, UUID, "left", "anna", tool="rallyscope 1") as store:
        store.put(ball(5))
        label = store.at(5)
    assert label is not None
    assert (label.provenance.annotator, label.provenance.tool) == ("anna", "rallyscope 1")
    assert label.provenance.made_at_us > 1_600_000_000_000_000


def test_columns_are_sorted_snapshots_that_follow_every_change(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        for t_us in (30, 10, 20):
            store.put(ball(t_us, x=t_us + 0.5))
        before = store.labels()
        store.put(ball(20, x=99.0))
        store.delete(10)
        store.put(Label(t_us=5, state=LabelState.NO_BALL))
        after = store.labels()
    np.testing.assert_array_equal(before.t_us, (10, 20, 30))
    np.testing.assert_array_equal(before.x_px, (10.5, 20.5, 30.5))
    np.testing.assert_array_equal(after.t_us, (5, 20, 30))
    np.testing.assert_array_equal(after.x_px, (np.nan, 99.0, 30.5))
    np.testing.assert_array_equal(after.seen, (False, True, True))
    assert not after.x_px.flags.writeable


def test_many_changes_at_once_give_the_same_columns_as_one_by_one(tmp_path: Path) -> None:
    with open_store(tmp_path) as one, open_store(tmp_path, "bea") as many:
        for t_us in range(200, 0, -1):
            one.put(ball(t_us))
            one.labels()
        many.edit(put=[ball(t_us) for t_us in range(1, 201)])
        np.testing.assert_array_equal(one.labels().t_us, many.labels().t_us)
        assert [label.x_px for label in one.all()] == [label.x_px for label in many.all()]


def test_unchecked_is_the_absence_of_a_label_and_not_a_negative(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(Label(t_us=10, state=LabelState.NO_BALL))
        store.put(ball(20))
        progress = store.progress([10, 20, 30, 40])
        assert (progress.total, progress.checked, progress.unchecked) == (4, 2, 2)
        assert dict(progress.by_state) == {LabelState.NO_BALL: 1, LabelState.VISIBLE: 1}
        assert store.at(30) is None
        assert store.next_unchecked([10, 20, 30, 40], after_us=30) == 40
        assert store.next_unchecked([10, 20, 30, 40], after_us=40) == 30
        assert store.next_unchecked([10, 20], after_us=0) is None


def test_a_segment_is_one_step_of_undo_and_one_line(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(ball(1))
        lines = store.path.read_bytes().count(b"\n")
        assert store.edit(put=[ball(2), ball(3)], delete=[1]) == 3
        assert store.path.read_bytes().count(b"\n") == lines + 1
        assert store.labels().t_us.tolist() == [2, 3]
        assert sorted(store.undo()) == [1, 2, 3]
        assert store.labels().t_us.tolist() == [1]


def test_undo_and_redo_go_on_after_a_restart(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        for t_us in (1, 2, 3):
            store.put(ball(t_us))
        store.undo()
    with open_store(tmp_path) as store:
        assert store.can_redo
        assert store.undo() == (2,)
        assert store.labels().t_us.tolist() == [1]
        store.redo()
        assert store.redo() == (3,)
        assert store.redo() == ()
        assert store.labels().t_us.tolist() == [1, 2, 3]


def test_a_change_that_changes_nothing_writes_nothing(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        version = store.version
        assert not store.delete(77)
        assert store.undo() == ()
        assert store.edit() == 0
        assert store.version == version


def test_annotators_and_cameras_do_not_see_each_other(tmp_path: Path) -> None:
    shelf = LabelStoreRegistry(tmp_path)
    shelf.store(UUID, "left", "anna").put(ball(1))
    shelf.store(UUID, "left", "../bob.blind").put(ball(2))
    shelf.store(UUID, "left", "anna", blind=True).put(ball(3))
    shelf.store(UUID, "right", "anna").put(ball(4))
    shelf.store("other", "left", "anna").put(ball(5))
    assert shelf.layers(UUID) == (
        Layer(UUID, "left", "../bob.blind"),
        Layer(UUID, "left", "anna"),
        Layer(UUID, "left", "anna", blind=True),
        Layer(UUID, "right", "anna"),
    )
    assert [shelf.read(layer).labels().t_us.tolist() for layer in shelf.layers(UUID)] == [[2], [1], [3], [4]]
    assert all(
        path.is_relative_to(tmp_path) for path in (layer.path(tmp_path).resolve() for layer in shelf.layers(UUID))
    )
    shelf.close()
    assert len(find_layers(tmp_path)) == 5


def test_a_shelf_gives_everybody_the_same_store(tmp_path: Path) -> None:
    shelf = LabelStoreRegistry(tmp_path)
    assert shelf.store(UUID, "left", "anna") is shelf.store(UUID, "left", "anna")
    with pytest.raises(LabelError, match="another program is writing"):
        open_store(tmp_path)
    shelf.close()
    open_store(tmp_path).close()


def test_the_last_user_of_a_shelf_closes_it_and_the_next_opens_it_again(tmp_path: Path) -> None:
    shelf = LabelStoreRegistry(tmp_path)
    for _ in range(2):
        shelf.acquire()
        shelf.acquire()
        store = shelf.store(UUID, "left", "anna")
        shelf.release()
        assert shelf.store(UUID, "left", "anna") is store
        shelf.release()
        open_store(tmp_path).close()


def test_a_layer_can_be_read_while_it_is_written_but_not_changed(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(ball(1))
        view = LabelStore.read(tmp_path, store.layer)
        assert view.labels().t_us.tolist() == [1]
        with pytest.raises(LabelError, match="reading only"):
            view.put(ball(2))
        assert view.labels().t_us.tolist() == [1]
    with pytest.raises(LabelError, match="no labels"):
        LabelStore.read(tmp_path, Layer(UUID, "left", "nobody"))


def test_threads_lose_nothing(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:

        def work(worker: int) -> None:
            for k in range(40):
                store.put(ball(worker * 1000 + k))

        threads = [threading.Thread(target=work, args=(worker,)) for worker in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(store.labels()) == 160
    with open_store(tmp_path) as store:
        assert len(store.labels()) == 160
        while store.undo():
            pass
        assert len(store.labels()) == 0


def test_a_folder_that_cannot_be_written_is_one_clear_error() -> None:
    with pytest.raises(LabelError, match=r"cannot write labels here.*--data"):
        LabelStore.open(Path("/proc/nowhere"), UUID, "left", "anna")


def test_labels_of_a_later_version_or_of_something_else_are_refused(tmp_path: Path) -> None:
    layer = Layer(UUID, "left", "anna")
    path = layer.path(tmp_path)
    path.parent.mkdir(parents=True)
    header = {"seq": 1, "op": "open", "format": "rallyscope-labels", "recording": UUID, "annotator": "anna"}
    path.write_bytes(pack_line({**header, "schema": 99, "camera": "left", "blind": False}))
    with pytest.raises(LabelError, match="another version"):
        open_store(tmp_path)
    path.write_bytes(pack_line({**header, "schema": 1, "camera": "right", "blind": False}))
    with pytest.raises(LabelError, match="something else"):
        open_store(tmp_path)
    path.write_bytes(pack_line({"seq": 1, "op": "paint"}))
    with pytest.raises(LabelError, match="unknown operation"):
        open_store(tmp_path)


def test_one_edit_may_not_contradict_itself(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(ball(1))
        with pytest.raises(LabelError, match="two things"):
            store.edit(put=[ball(1)], delete=[1])
        with pytest.raises(LabelError, match="two things"):
            store.edit(put=[ball(2), ball(2)])
        assert store.labels().t_us.tolist() == [1]


@pytest.mark.parametrize("names", [("", "left", "anna"), (UUID, " ", "anna"), (UUID, "left", "")])
def test_a_layer_needs_all_its_names(tmp_path: Path, names: tuple[str, str, str]) -> None:
    with pytest.raises(LabelError, match="need a name"):
        LabelStore.open(tmp_path, *names)
