"""Two annotators without a browser: they disagree, one settles it, and the store holds the result."""

import queue
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from app.modes.label.by_hand import place_ball
from app.modes.label.comparer import FOLDER, LabelComparer, OtherStores
from app.modes.label.comparison import LabelComparison
from app.modes.label.editor import LabelCallbacks, LabelEditor
from app.modes.label.keys import ACTS
from app.modes.label.labelling import Labelling, LabelView, begin_labelling
from app.modes.label.merge_panel import panel_html
from app.modes.label.plan import LabelScene, centre_at, plan_at
from app.modes.services import LABEL_TOOL
from app.pictures.palette import PaletteIndex
from core.recordings import open_recording
from labels.conflicts import find_conflicts, how_settled
from labels.model import ContactKind, ContactLabel, Label, LabelState, PositionSource
from labels.store import LabelStore, Layer
from labels.store_contents import read_store
from labels.store_registry import LabelStoreRegistry
from tests.waiting import eventually

AT_US = (10_000, 12_000, 14_000, 16_000)


def ball(t_us: int, x: float, r_px: float | None = 6.0) -> Label:
    return Label(t_us=t_us, state=LabelState.VISIBLE, x_px=x, y_px=40.0, r_px=r_px)


def nothing(t_us: int) -> Label:
    return Label(t_us=t_us, state=LabelState.NO_BALL)


MINE = (*(ball(t_us, 50.0) for t_us in AT_US), ball(30_000, 60.0), ball(40_000, 60.0))
THEIRS = (*(ball(t_us, 60.0, 8.0) for t_us in AT_US[:3]), nothing(AT_US[3]), ball(30_000, 61.0), ball(50_000, 70.0))


class Desk:
    """An annotator who compares, with a loop of its own."""

    def __init__(self, root: Path, recording: Path, annotator: str = "anna") -> None:
        self.root, self.errors, self.notes = root, [], []
        self._inbox: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self.recording = open_recording(recording)
        callbacks = LabelCallbacks(
            lambda act: True, self._inbox.put, self.errors.append, self.notes.append, lambda t_us: None
        )
        labelling = begin_labelling(self.recording, LabelView(camera="left", annotator=annotator), 2000, 0.0)
        self.editor = LabelEditor(LabelStoreRegistry(root / "labels", tool=LABEL_TOOL), labelling, callbacks, annotator)
        self.pool = ThreadPoolExecutor(2)
        self.comparer = LabelComparer(self.editor, root / "labels", OtherStores(root), self.pool)
        self.wait(lambda: {"left", "right"} <= set(self.work.saved))

    @property
    def work(self) -> Labelling:
        return self.editor.labelling

    @property
    def found(self) -> LabelComparison:
        assert self.work.compared_here is not None
        return self.work.compared_here

    @property
    def counts(self) -> tuple[int, int]:
        """Settled, and open."""
        found = self.work.compared_here
        return (-1, -1) if found is None else (len(found.resolved_us), len(found.open_us))

    def close(self) -> None:
        self.comparer.close()
        self.editor.close()
        self.pool.shutdown()
        self.recording.close()

    def wait(self, condition: Callable[[], object]) -> None:
        """Run the loop until the condition holds, and nothing is waiting."""

        def turn() -> bool:
            while not self._inbox.empty():
                self._inbox.get()()
            if condition() and not self.editor.writer.waiting and self._inbox.empty():
                return True
            self.editor.look_again(time.monotonic())
            self.comparer.tick(time.monotonic())
            return False

        eventually(turn, "what the annotator is to see", lambda: (self.counts, self.comparer.problem, self.errors))

    def choose(self, title: str) -> None:
        self.wait(lambda: title in self.comparer.offered)
        self.comparer.choose(title)

    def scene(self) -> LabelScene:
        return LabelScene(self.work)

    def look(self, t_us: int | None = None):
        if t_us is not None:
            self.editor.go_to(t_us)
        scene = self.scene()
        plan = plan_at(scene, self.work.t_us, centre_at(scene, self.work.t_us, None))
        self.editor.show(plan)
        return plan

    def press(self, name: str, t_us: int | None = None) -> None:
        self.look(t_us)
        self.editor.do(ACTS[name])
        self.wait(lambda: True)

    def on_disk(self, annotator: str = "anna") -> LabelStore:
        return LabelStore.read(self.root / "labels", Layer(self.recording.uuid, "left", annotator))


def fill(folder: Path, recording: Path, annotator: str, *labels: Label) -> None:
    with open_recording(recording) as opened, LabelStore.open(folder, opened.uuid, "left", annotator) as store:
        store.edit(put=labels)


@pytest.fixture
def desk(tmp_path: Path, serve_recording: Path) -> Iterator[Desk]:
    fill(tmp_path / "labels", serve_recording, "anna", *MINE)
    fill(tmp_path / "labels", serve_recording, "bea", *THEIRS)
    desk = Desk(tmp_path, serve_recording)
    desk.choose("bea")
    desk.wait(lambda: desk.counts == (0, 4))
    yield desk
    desk.close()


def test_what_differs_is_counted_and_both_are_drawn(desk: Desk) -> None:
    found = desk.found
    assert found.open_us.tolist() == list(AT_US) and (found.agreed, found.only_mine) == (1, 1)
    assert found.only_theirs_us.tolist() == [50_000]
    plan = desk.look(AT_US[0])
    assert [mark.ink for mark in plan.main.marks[:2]] == [PaletteIndex.MINE, PaletteIndex.THEIRS]
    assert [text for text, _ in plan.legend] == ["anna: visible, r 6.00 px", "bea: visible, r 8.00 px"]
    assert "0 of 4 settled" in panel_html(desk.work, "", (), waiting=True)
    assert desk.look(30_000).legend == () and len(desk.look(50_000).legend) == 2


def test_the_others_contacts_come_from_all_cameras_and_what_is_added_later_is_seen(desk: Desk) -> None:
    bounce, hit = ContactLabel(t_us=5_000, kind=ContactKind.BOUNCE), ContactLabel(t_us=90_000, kind=ContactKind.HIT)
    times = lambda: [one.t_us for one in desk.found.theirs.contacts]  # noqa: E731
    for camera, contact, expected in (("left", hit, [90_000]), ("right", bounce, [5_000, 90_000])):
        with LabelStore.open(desk.root / "labels", desk.recording.uuid, camera, "bea") as store:
            store.edit(put_contacts=[contact])
        desk.wait(lambda expected=expected: times() == expected)


def test_each_way_of_settling_is_an_edit_of_ones_own_that_says_so(desk: Desk) -> None:
    for number, name in enumerate(("take_mine", "take_theirs", "take_mean", "take_theirs")):
        assert desk.work.t_us == (0 if number == 0 else AT_US[number])
        desk.press(name, AT_US[number])
        desk.wait(lambda number=number: desk.counts == (number + 1, 3 - number))
    kept, theirs = desk.on_disk(), desk.on_disk("bea")
    labels = [kept.at(t_us) for t_us in AT_US]
    assert [label.x_px for label in labels] == [50.0, 60.0, 55.0, None]
    assert [label.r_px for label in labels] == [6.0, 8.0, 7.0, None]
    assert labels[3].state is LabelState.NO_BALL
    assert {(label.provenance.source, label.provenance.annotator) for label in labels} == {
        (PositionSource.SETTLED, "anna")
    }
    over = zip(labels, (theirs.at(t_us) for t_us in AT_US), strict=True)
    assert [how_settled(label, "bea", other) for label, other in over] == ["mine", "theirs", "mean", "theirs"]
    assert [label.t_us for label in theirs.all()] == [label.t_us for label in THEIRS], "the other's layer is untouched"
    assert theirs.labels().x_px[:3].tolist() == [60.0] * 3
    found = find_conflicts(read_store(kept.path).layers)
    assert [(c.t_us, c.settled_by) for c in found] == [(AT_US[0], "anna"), (AT_US[2], "anna")], "the command agrees"


def test_undo_brings_a_conflict_back_and_redo_settles_it_again(desk: Desk) -> None:
    desk.press("take_mine", AT_US[0])
    desk.wait(lambda: desk.counts == (1, 3))
    desk.press("undo")
    desk.wait(lambda: desk.counts == (0, 4))
    assert desk.work.t_us == AT_US[0] and desk.on_disk().at(AT_US[0]).provenance.source is PositionSource.BY_HAND
    desk.press("redo")
    desk.wait(lambda: desk.counts == (1, 3))


def test_a_settled_conflict_does_not_come_back_after_a_restart_nor_for_the_other(
    desk: Desk, serve_recording: Path
) -> None:
    desk.press("take_mean", AT_US[1])
    desk.wait(lambda: desk.counts == (1, 3))
    for name, other in (("anna", "bea"), ("bea", "anna")):
        again = Desk(desk.root, serve_recording, name)
        try:
            again.choose(other)
            again.wait(lambda again=again: again.counts == (1, 3))
            assert again.found.resolved_us.tolist() == [AT_US[1]]
        finally:
            again.close()


def test_what_the_other_says_later_is_a_conflict_anew(desk: Desk, serve_recording: Path) -> None:
    desk.press("take_mine", AT_US[1])
    desk.wait(lambda: desk.counts == (1, 3))
    fill(desk.root / "labels", serve_recording, "bea", ball(AT_US[1], 90.0))
    desk.wait(lambda: desk.counts == (0, 4))
    fill(desk.root / "labels", serve_recording, "bea", ball(AT_US[1], 50.5))
    desk.wait(lambda: desk.counts == (0, 3))
    assert desk.found.agreed == 2, "and gone once both say the same"


def test_a_click_and_every_other_key_at_a_conflict_settle_it_with_a_new_label(desk: Desk) -> None:
    desk.editor.change_view({"snap": False})
    desk.look(AT_US[0])
    place_ball(desk.editor, 53.0, 41.0)
    desk.wait(lambda: desk.counts == (1, 3))
    label = desk.on_disk().at(AT_US[0])
    assert (label.x_px, label.y_px, label.provenance.source) == (53.0, 41.0, PositionSource.SETTLED)
    assert how_settled(label, "bea", desk.on_disk("bea").at(AT_US[0])) == "new"
    desk.press("left", AT_US[1])
    desk.press("partly", AT_US[2])
    desk.press("out_of_frame", AT_US[3])
    desk.wait(lambda: desk.counts == (4, 0))
    desk.look(30_000)
    place_ball(desk.editor, 60.5, 40.0)
    desk.wait(lambda: desk.on_disk().at(30_000).x_px == 60.5)
    assert desk.on_disk().at(30_000).provenance.source is PositionSource.BY_HAND, "no conflict was there"


def test_the_keys_lead_from_conflict_to_conflict_and_say_when_there_is_none(desk: Desk) -> None:
    times = []
    for name in ("next_conflict", "next_conflict", "previous_conflict", "previous_conflict"):
        desk.press(name)
        times.append(desk.work.t_us)
    assert times == [AT_US[0], AT_US[1], AT_US[0], AT_US[3]]
    desk.press("take_mean", AT_US[3])
    assert desk.notes[-1].title == "No mean of these" and desk.counts == (0, 4)
    desk.press("take_theirs", 30_000)
    assert desk.notes[-1].title == "No conflict here"
    for t_us in AT_US:
        desk.press("take_mine", t_us)
    desk.wait(lambda: desk.counts == (4, 0))
    desk.press("next_conflict")
    assert desk.notes[-1].title == "No conflict is open" and not desk.errors


def test_nothing_is_settled_unseen_in_a_second_look_or_without_a_comparison(desk: Desk) -> None:
    desk.look(AT_US[0])
    desk.editor.go_to(AT_US[1])
    desk.editor.do(ACTS["take_theirs"])  # the picture is still the one before
    desk.wait(lambda: True)
    assert desk.on_disk().at(AT_US[1]).x_px == 50.0
    desk.editor.change_view({"repeat": True})
    assert desk.work.compared_here is None and desk.look().legend == ()
    desk.editor.change_view({"repeat": False})
    desk.comparer.choose("nobody")
    desk.press("take_theirs", AT_US[1])
    assert desk.notes[-1].title == "No second annotator is chosen" and desk.on_disk().at(AT_US[1]).x_px == 50.0


def test_another_camera_or_annotator_is_compared_anew(desk: Desk) -> None:
    desk.editor.change_view({"camera": "right"})
    assert desk.work.compared is None
    desk.wait(lambda: desk.counts == (0, 0))
    assert desk.found.camera == "right"
    desk.editor.change_view({"annotator": "cleo"})
    desk.editor.change_view({"camera": "left"})
    desk.wait(lambda: desk.counts == (0, 0) and len(desk.found.only_theirs_us) == len(THEIRS))
    desk.editor.change_view({"annotator": "bea"})
    desk.wait(lambda: desk.comparer.chosen is None)
    assert desk.work.compared is None, "nobody is compared with oneself"


def test_what_only_the_other_has_is_taken_over_as_it_is_and_given_back_in_one_step(desk: Desk) -> None:
    desk.press("take_missing")
    desk.wait(lambda: not len(desk.found.only_theirs_us))
    label = desk.on_disk().at(50_000)
    assert (label.x_px, label.provenance.annotator, label.provenance.source) == (70.0, "bea", PositionSource.BY_HAND)
    assert desk.notes[-1].title == "Taken over" and "1 label of" in desk.notes[-1].text
    desk.press("take_missing")
    assert desk.notes[-1].title == "Nothing to take over"
    desk.press("undo")
    desk.wait(lambda: desk.found.only_theirs_us.tolist() == [50_000])
    desk.press("take_theirs", 50_000)
    desk.wait(lambda: not len(desk.found.only_theirs_us))
    assert desk.on_disk().at(50_000).provenance.annotator == "bea" and desk.work.t_us == 50_000


def test_a_store_of_a_colleague_is_compared_settled_and_never_written_to(
    desk: Desk, tmp_path: Path, serve_recording: Path
) -> None:
    fill(tmp_path / "elsewhere", serve_recording, "cleo", *THEIRS)
    (source,) = (tmp_path / "elsewhere").rglob("labels.sqlite")
    file = tmp_path / FOLDER / "cleo.sqlite"
    file.parent.mkdir()
    file.write_bytes(source.read_bytes())
    desk.comparer._listed_s = float("-inf")
    desk.choose(f"cleo in {FOLDER}/cleo.sqlite")
    desk.wait(lambda: desk.counts == (0, 4))
    desk.press("take_theirs", AT_US[0])
    desk.wait(lambda: desk.counts == (1, 3))
    assert how_settled(desk.on_disk().at(AT_US[0]), "cleo", read_store(file).layers[
        Layer(desk.recording.uuid, "left", "cleo")][AT_US[0]]) == "theirs"  # fmt: skip
    assert file.read_bytes() == source.read_bytes() and list(file.parent.iterdir()) == [file]
    fill(tmp_path / "elsewhere", serve_recording, "cleo", ball(AT_US[1], 50.0))
    file.write_bytes(source.read_bytes())
    desk.wait(lambda: desk.counts == (1, 2))
    file.write_bytes(b"SQLite format 3\x00" + b"\xa5" * 9_000)
    desk.wait(lambda: desk.comparer.problem)
    assert "cleo.sqlite" in desk.comparer.problem and str(tmp_path) not in desk.comparer.problem
    assert "\n" not in desk.comparer.problem and desk.work.compared is None and not desk.errors
    assert "cleo.sqlite" in panel_html(desk.work, desk.comparer.problem, (), waiting=True)
    desk.comparer.choose("bea")
    desk.wait(lambda: desk.counts == (0, 3) and not desk.comparer.problem)  # of one, bea says what cleo said


def test_of_a_damaged_store_what_can_be_read_is_compared_and_that_is_said(desk: Desk, serve_recording: Path) -> None:
    fill(desk.root / "elsewhere", serve_recording, "cleo", *(ball(t_us, 90.0) for t_us in range(9_000, 12_001)))
    (source,) = (desk.root / "elsewhere").rglob("labels.sqlite")
    content = bytearray(source.read_bytes())
    content[40 * 4096 : 41 * 4096] = b"\xa5" * 4096
    file = desk.root / FOLDER / "cleo.sqlite"
    file.parent.mkdir()
    file.write_bytes(content)
    desk.comparer._listed_s = float("-inf")
    desk.choose(f"cleo in {FOLDER}/cleo.sqlite")
    desk.wait(lambda: desk.work.compared_here is not None)
    assert 1_000 < len(desk.found.only_theirs_us) < 3_000
    (note,) = desk.comparer.notes
    assert "cleo.sqlite: damaged" in note and str(desk.root) not in note
    assert "damaged" in panel_html(desk.work, "", desk.comparer.notes, waiting=True)
    assert file.read_bytes() == content and list(file.parent.iterdir()) == [file]


def test_an_edit_that_fails_leaves_the_conflict_open(desk: Desk) -> None:
    desk.look(AT_US[0])
    store = desk.editor.writer.store(desk.work.layer)
    store.close()  # as if the disk were gone
    desk.editor.do(ACTS["take_mine"])
    desk.wait(lambda: desk.errors)
    desk.wait(lambda: desk.counts == (0, 4))
