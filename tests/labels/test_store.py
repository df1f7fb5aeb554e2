from __future__ import annotations

import shutil
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from core.errors import LabelError
from labels.merging import merge_stores
from labels.model import Label, LabelState, PositionSource, Provenance
from labels.store import LabelStore, Layer, UndoStep, find_annotators, find_layers
from labels.store_registry import LabelStoreRegistry
from tests.waiting import PATIENCE_S

UUID = "9f3c-1"


def ball(t_us: int, x: float = 10.0, y: float = 20.0, state: LabelState = LabelState.VISIBLE) -> Label:
    return Label(t_us=t_us, state=state, x_px=x, y_px=y)


def open_store(folder: Path, annotator: str = "anna", session: str = "") -> LabelStore:
    return LabelStore.open(folder, UUID, "left", annotator, session=session)


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


def test_who_has_only_begun_a_layer_has_not_labelled(tmp_path: Path) -> None:
    for annotator, blind in (("anna", False), ("zoe", False), ("mia", True)):
        with LabelStore.open(tmp_path, UUID, "left", annotator, blind=blind) as store:
            if annotator != "anna":
                store.put(ball(5))
    assert {layer.annotator for layer in find_layers(tmp_path, UUID)} == {"anna", "mia", "zoe"}
    assert find_annotators(tmp_path, UUID) == ("zoe",)
    assert find_annotators(tmp_path, "another") == ()


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


def test_a_segment_is_one_step_of_undo_and_one_edit(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(ball(1))
        version = store.version
        assert store.edit(put=[ball(2), ball(3)], delete=[1]) == 3
        assert store.version == version + 1
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
    looked_at = [shelf.look(layer) for layer in shelf.layers(UUID)]
    assert [store and store.labels().t_us.tolist() for store in looked_at] == [[2], [1], [3], [4]]
    assert all(
        path.is_relative_to(tmp_path) for path in (layer.path(tmp_path).resolve() for layer in shelf.layers(UUID))
    )
    shelf.close()
    assert len(find_layers(tmp_path)) == 5


def test_a_shelf_gives_everybody_the_same_store(tmp_path: Path) -> None:
    shelf = LabelStoreRegistry(tmp_path)
    assert shelf.store(UUID, "left", "anna") is shelf.store(UUID, "left", "anna")
    assert shelf.store(UUID, "left", "anna") is not shelf.store(UUID, "left", "anna", session="b")
    shelf.close()
    open_store(tmp_path).close()


def test_the_last_user_of_a_session_closes_its_stores_and_the_next_opens_them_again(tmp_path: Path) -> None:
    shelf = LabelStoreRegistry(tmp_path)
    other = shelf.store(UUID, "left", "anna", session="b")
    for _ in range(2):
        shelf.acquire("a")
        shelf.acquire("a")
        store = shelf.store(UUID, "left", "anna", session="a")
        shelf.release("a")
        assert shelf.store(UUID, "left", "anna", session="a") is store
        shelf.release("a")
        with pytest.raises(LabelError, match="reading only"):
            store.put(ball(1))
    other.put(ball(2))
    shelf.close()


def test_a_look_leaves_no_trace_and_follows_what_others_write(tmp_path: Path) -> None:
    shelf, layer = LabelStoreRegistry(tmp_path), Layer(UUID, "left", "anna")
    assert shelf.look(layer, "a") is None and list(tmp_path.iterdir()) == []
    with open_store(tmp_path) as store:
        store.put(ball(1))
        seen = shelf.look(layer, "a")
        assert seen is not None and seen.labels().t_us.tolist() == [1]
        version = seen.version
        store.put(ball(2))
        assert seen.version > version and seen.labels().t_us.tolist() == [1, 2]
        assert shelf.look(layer, "a") is seen
        assert shelf.store(UUID, "left", "anna", session="a") is shelf.look(layer, "a") is not seen
    shelf.close()


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


WRITE = """
import sys
from pathlib import Path
from labels.database import connection
from labels.store import LabelStore
from labels.model import Label, LabelState
connection.WAITS_S = float(sys.argv[4])
name, count = sys.argv[2], int(sys.argv[3])
with LabelStore.open(Path(sys.argv[1]), "9f3c-1", "left", name) as store:
    for k in range(count):
        store.put(Label(t_us=1000 * k, state=LabelState.VISIBLE, x_px=float(k), y_px=1.0))
    print(len(store.labels()))
"""


@pytest.mark.gate
def test_eight_annotators_in_processes_of_their_own_write_at_once_and_none_is_lost_or_doubled(tmp_path: Path) -> None:
    names, count = [f"annotator {k}" for k in range(8)], 40
    arguments = [(str(tmp_path), name, str(count), str(PATIENCE_S)) for name in names]  # however busy the disk is
    writers = [subprocess.Popen([sys.executable, "-c", WRITE, *one], stdout=subprocess.PIPE) for one in arguments]
    assert [int(writer.communicate()[0]) for writer in writers] == [count] * 8
    assert [layer.annotator for layer in find_layers(tmp_path)] == names
    for name in names:
        labels = LabelStore.read(tmp_path, Layer(UUID, "left", name)).all()
        assert [label.x_px for label in labels] == list(range(count))
        assert {label.provenance.annotator for label in labels} == {name}
    with closing(sqlite3.connect(Layer(UUID, "left", "x").path(tmp_path))) as db:
        assert db.execute("SELECT count(*) FROM edits WHERE kind = 'edit'").fetchone() == (8 * count,)


def test_two_sessions_of_one_annotator_see_each_other_and_undo_only_their_own(tmp_path: Path) -> None:
    one = LabelStore.open(tmp_path, UUID, "left", "anna", session="one")
    two = LabelStore.open(tmp_path, UUID, "left", "anna", session="two")
    with one, two:
        one.put(ball(1, x=1.0))
        version = one.version
        two.put(ball(2, x=2.0))
        assert one.version > version and one.labels().t_us.tolist() == [1, 2]
        assert one.undo() == (1,), "what the other did last is not taken back"
        assert two.labels().t_us.tolist() == [2] and not one.can_undo
        assert one.undo() == ()
        one.redo()
        assert two.at(1) == one.at(1) is not None


def test_undo_leaves_what_another_has_changed_since_and_says_so(tmp_path: Path) -> None:
    one = LabelStore.open(tmp_path, UUID, "left", "anna", session="one")
    two = LabelStore.open(tmp_path, UUID, "left", "anna", session="two")
    with one, two:
        one.edit(put=[ball(1), ball(2)])
        two.put(ball(1, x=99.0))
        step = one.step_back()
        assert (step.touched_us, step.left_us) == ((2,), (1,)) and step.done
        label = two.at(1)
        assert label is not None and label.x_px == 99.0
        assert two.undo() == (1,) and (again := two.at(1)) is not None and again.x_px == 10.0
        assert not one.step_back().done


def test_the_layer_as_a_whole_is_undone_where_no_session_is_named(tmp_path: Path) -> None:
    with LabelStore.open(tmp_path, UUID, "left", "anna", session="browser") as browser:
        browser.put(ball(1))
    with open_store(tmp_path) as script:
        assert script.undo() == (1,)


def test_a_snapshot_by_time_stays_what_it_was(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(ball(1, x=1.0))
        store.put(ball(2))
        before = store.by_time()
        store.put(ball(1, x=9.0))
        store.delete(2)
        assert sorted(before) == [1, 2] and before[1].x_px == 1.0 and before[2] == ball_of(before, 2)
        assert dict(store.by_time()) == {1: store.at(1)} and 2 not in store.by_time() and store.by_time().get(2) is None


def ball_of(labels: Mapping[int, Label], t_us: int) -> Label:
    return dict(labels)[t_us]


def test_a_rejected_proposal_is_a_step_of_undo_and_no_label(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(ball(1))
        store.reject(5, 1.5, 2.5, 3.0, "auto#12")
        assert store.rejected() == {(5, "auto#12")} and store.at(5) is None
        assert store.undo() == (5,) and store.rejected() == frozenset()
        assert store.redo() == (5,) and store.rejected() == {(5, "auto#12")}
        store.undo()
    with open_store(tmp_path) as store:
        assert store.rejected() == frozenset() and store.redo() == (5,)
        store.reject(5, 1.5, 2.5, 3.0, "auto#12")
        assert store.undo() == (5,) and store.undo() == (1,), "what is said twice is one step"
        store.reject(5, 1.5, 2.5, 3.0, "auto#12")
    with open_store(tmp_path) as store:
        assert store.rejected() == {(5, "auto#12")}


def test_undo_leaves_a_proposal_rejected_that_another_session_has_rejected_since(tmp_path: Path) -> None:
    with open_store(tmp_path, session="a") as one, open_store(tmp_path, session="b") as other:
        one.reject(5, 1.5, 2.5, None, "auto#12")
        one.undo()
        other.reject(5, 1.5, 2.5, None, "auto#12")
        assert one.step_back(redo=True) == UndoStep((), (5,)) and one.rejected() == {(5, "auto#12")}
        assert one.undo() == () and other.undo() == (5,) and one.rejected() == frozenset()


def test_a_rejection_of_an_earlier_version_stays_and_undo_goes_past_it(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(ball(1))
        store.reject(5, 1.5, 2.5, 3.0, "auto#12")
        with store.writing() as db:
            db.execute("UPDATE edits SET kind = 'rejected proposal' WHERE edit = 2")
    with open_store(tmp_path) as store:
        assert store.undo() == (1,) and not store.can_undo and store.rejected() == {(5, "auto#12")}


FILL = """
import resource, signal, sys
from pathlib import Path
from core.errors import LabelError
from labels.model import Label, LabelState
from labels.store import LabelStore
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
store = LabelStore.open(Path(sys.argv[1]), "u", "left", "anna")
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, resource.RLIM_INFINITY))
saved = 0
try:
    for t_us in range(10**6):
        store.put(Label(t_us=t_us, state=LabelState.NO_BALL))
        saved += 1
except LabelError as error:
    print(error)
assert len(store.labels()) == saved, "memory holds what is not saved"
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
store.put(Label(t_us=saved, state=LabelState.NO_BALL))
print(saved)
"""


def test_a_full_disk_is_one_clear_error_and_loses_nothing(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", FILL, str(tmp_path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    message, saved = done.stdout.splitlines()
    assert "not saved" in message
    assert "labels.sqlite" in message
    assert int(saved) > 5
    with LabelStore.open(tmp_path, "u", "left", "anna") as store:
        assert store.labels().t_us.tolist() == list(range(int(saved) + 1))
        assert store.notes == ()


def test_a_store_that_is_a_folder_is_a_clear_error(tmp_path: Path) -> None:
    path = Layer(UUID, "left", "anna").path(tmp_path)
    path.mkdir(parents=True)
    with pytest.raises(LabelError, match="cannot write labels here"):
        open_store(tmp_path)


def test_a_log_that_a_kill_has_left_is_read_without_writing(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(ball(1))
        copy = tmp_path / "copy" / store.path.parent.name
        shutil.copytree(store.path.parent, copy)  # as it lies on the disk in the middle of the work
    assert (copy / "labels.sqlite-wal").stat().st_size > 0
    assert LabelStore.read(copy.parent, Layer(UUID, "left", "anna")).labels().t_us.tolist() == [1]


def test_the_file_alone_holds_all_labels_after_a_rest_and_after_a_kill(tmp_path: Path) -> None:
    layer, alone, killed = Layer(UUID, "left", "anna"), tmp_path / "alone", tmp_path / "killed"
    with open_store(tmp_path) as store:
        store.put(ball(1))
        store.checkpoint()
        copied_alone(store.path, alone)
        store.put(ball(2))
        shutil.copytree(store.path.parent, killed / store.path.parent.name)  # as a kill leaves it: half in the log
    assert LabelStore.read(alone, layer).labels().t_us.tolist() == [1]
    LabelStoreRegistry(killed)
    copied_alone(layer.path(killed), tmp_path / "copy")
    assert LabelStore.read(tmp_path / "copy", layer).labels().t_us.tolist() == [1, 2]


def copied_alone(store: Path, folder: Path) -> Path:
    """Copy of a store's file without the log beside it."""
    copy = folder / store.parent.name / store.name
    copy.parent.mkdir(parents=True)
    shutil.copy(store, copy)
    return copy


def test_a_store_that_was_copied_without_its_log_names_that_cause(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(ball(1))
        copy = copied_alone(store.path, tmp_path / "copy")
    for read in (lambda: LabelStore.read(tmp_path / "copy", store.layer), lambda: merge_stores([copy], tmp_path / "m")):
        with pytest.raises(LabelError, match="without its log") as raised:
            read()
        assert "labels.sqlite-wal" in str(raised.value)
