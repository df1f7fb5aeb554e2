"""Journals of version 1, written here as that version wrote them."""

from __future__ import annotations

import fcntl
import json
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from core.errors import LabelError
from labels.model import LabelState
from labels.store import LabelStore, Layer, find_annotators, find_layers

UUID = "9f3c-1"
LAYER = Layer(UUID, "left", "anna")
HEADER = {"op": "open", "schema": 1, "format": "rallyscope-labels", "recording": UUID, "camera": "left"}
HEADER |= {"annotator": "anna", "blind": False}


def line(record: dict[str, object]) -> bytes:
    head = json.dumps(record, separators=(",", ":"), ensure_ascii=False)[:-1].encode()
    return b'%b,"crc":"%08x"}\n' % (head, zlib.crc32(head))


def ball(t_us: int, **more: object) -> dict[str, object]:
    made = {"source": "by_hand", "by": "anna", "at_us": 1_700_000_000_000_000 + t_us, "tool": "old 1"}
    return {"t_us": t_us, "state": "visible", "x": 10.0, "y": 20.0, "r": 5.0, **made, **more}


def put(*labels: dict[str, object]) -> dict[str, object]:
    return {"op": "edit", "put": list(labels), "delete": []}


def write_journal(folder: Path, *records: dict[str, object], layer: Layer = LAYER) -> Path:
    path = layer.journal(folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    header = {**HEADER, "camera": layer.camera, "annotator": layer.annotator, "blind": layer.blind}
    path.write_bytes(b"".join(line({"seq": seq, **each}) for seq, each in enumerate((header, *records), start=1)))
    return path


def test_a_journal_is_taken_over_and_kept_beside(tmp_path: Path) -> None:
    path = write_journal(
        tmp_path, put(ball(1)), put(ball(2)), put(ball(1, x=11.0)), {"op": "undo", "of": 4}, {"op": "redo", "of": 4}
    )
    content = path.read_bytes()
    blind = Layer(UUID, "left", "anna", blind=True)
    other = Layer(UUID, "right", "Jörg Ö./2")
    write_journal(tmp_path, put(ball(7)), layer=blind)
    write_journal(tmp_path, put(ball(8)), layer=other)
    assert set(find_layers(tmp_path)) == {LAYER, blind, other}
    assert find_annotators(tmp_path, UUID) == ("Jörg Ö./2", "anna")
    with LabelStore.open(tmp_path, UUID, "left", "anna") as store:
        assert store.labels().x_px.tolist() == [11.0, 10.0]
        label = store.at(1)
        assert label is not None and label.provenance.made_at_us == 1_700_000_000_000_001
        assert any(f"{path.name}.backup" in note for note in store.notes)
        assert store.undo() == (1,) and store.undo() == (2,) and store.undo() == (1,) and store.undo() == ()
    assert not path.exists() and path.with_name("anna.jsonl.backup").read_bytes() == content
    assert set(find_layers(tmp_path)) == {LAYER, blind, other}
    assert LabelStore.read(tmp_path, other).labels().t_us.tolist() == [8]
    with LabelStore.open(tmp_path, UUID, "left", "anna") as store:
        assert store.notes == ()


def test_reading_takes_nothing_over(tmp_path: Path) -> None:
    path = write_journal(tmp_path, put(ball(1)))
    store = LabelStore.read(tmp_path, LAYER)
    assert store.labels().t_us.tolist() == [1] and path.is_file() and not LAYER.path(tmp_path).exists()
    with pytest.raises(LabelError, match="reading only"):
        store.delete(1)


def test_a_kill_before_the_new_name_does_not_take_a_journal_over_twice(tmp_path: Path) -> None:
    path = write_journal(tmp_path, put(ball(1)))
    content = path.read_bytes()
    with LabelStore.open(tmp_path, UUID, "left", "anna") as store:
        store.delete(1)
    path.write_bytes(content)  # as if the rename had not come about
    with LabelStore.open(tmp_path, UUID, "left", "anna") as store:
        assert store.labels().t_us.tolist() == []
    assert not path.exists() and path.with_name("anna.jsonl.backup-2").read_bytes() == content


@pytest.mark.parametrize("radius", [0, -3.0, 0.0])
def test_a_radius_of_0_becomes_one_that_is_not_known(tmp_path: Path, radius: float) -> None:
    write_journal(tmp_path, put(ball(1, r=radius)))
    with LabelStore.open(tmp_path, UUID, "left", "anna") as store:
        label = store.at(1)
    assert label is not None and label.state is LabelState.VISIBLE and (label.x_px, label.r_px) == (10.0, None)


def test_a_journal_cut_anywhere_gives_every_line_before_the_cut(tmp_path: Path) -> None:
    path = write_journal(tmp_path, *(put(ball(t_us)) for t_us in range(1, 4)))
    content = path.read_bytes()
    for cut in range(len(content) + 1):
        path.write_bytes(content[:cut])
        whole = content[:cut].count(b"\n")
        assert LabelStore.read(tmp_path, LAYER).labels().t_us.tolist() == list(range(1, whole))


def test_a_damaged_line_in_the_middle_is_named_and_the_others_are_kept(tmp_path: Path) -> None:
    path = write_journal(tmp_path, put(ball(1)), put(ball(2)), {"op": "undo", "of": 3}, put(ball(3)))
    path.write_bytes(path.read_bytes().replace(b'"t_us":2', b'"t_us":4'))
    with LabelStore.open(tmp_path, UUID, "left", "anna") as store:
        assert store.labels().t_us.tolist() == [1, 3]
        assert store.notes[0] == f"{path}:3: damaged line, left out"
        assert "undo of edit 3" in store.notes[1]


def test_a_journal_that_an_earlier_version_still_writes_is_not_taken_over(tmp_path: Path) -> None:
    path = write_journal(tmp_path, put(ball(1)))
    with path.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(LabelError, match="another program is writing"):
            LabelStore.open(tmp_path, UUID, "left", "anna")
    assert path.is_file()
    with LabelStore.open(tmp_path, UUID, "left", "anna") as store:
        assert store.labels().t_us.tolist() == [1]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda record: {**record, "schema": 99}, "another version"),
        (lambda record: {**record, "camera": "right"}, "something else"),
        (lambda record: {"op": "paint"}, "unknown operation"),
        (lambda record: {"op": "edit", "put": 3, "delete": []}, "not an edit"),
        (lambda record: {"op": "edit", "put": [{"t_us": 1}], "delete": []}, "not a label"),
        (lambda record: put(ball(1, source="magic")), "not a label"),
    ],
)
def test_what_version_1_never_wrote_is_refused_and_left_alone(
    tmp_path: Path, spoil: Callable[[dict[str, object]], dict[str, object]], message: str
) -> None:
    path = write_journal(tmp_path)
    path.write_bytes(line({"seq": 1, **spoil(HEADER)}))
    content = path.read_bytes()
    with pytest.raises(LabelError, match=message):
        LabelStore.open(tmp_path, UUID, "left", "anna")
    assert path.read_bytes() == content
