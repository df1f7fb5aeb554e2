"""Whose labels are offered for a comparison: names only, of stores that lie in known folders."""

import os
import sqlite3
from pathlib import Path

import pytest

from app.modes.label.comparer import FOLDER, OtherLabels, OtherStores, RefusedStore, others_to_compare, refusal
from labels.model import Label, LabelState
from labels.store import LabelStore, Layer, find_layers

UUID = "rec-1"
NOTHING = Label(t_us=1, state=LabelState.NO_BALL)


def make(folder: Path, *annotators: str, uuid: str = UUID) -> Path:
    """A store as the program makes it; its file."""
    for annotator in annotators:
        with LabelStore.open(folder, uuid, "left", annotator) as store:
            store.put(NOTHING)
    return next((folder / uuid).glob("*.sqlite"))


def put(path: Path, target: Path) -> Path:
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(path.read_bytes())
    return target


def test_other_annotators_of_the_store_come_first_and_oneself_is_not_among_them(tmp_path: Path) -> None:
    make(tmp_path, "anna", "bea", "cleo")
    with LabelStore.open(tmp_path, UUID, "left", "dora", blind=True) as store:
        store.put(NOTHING)
    found = others_to_compare("anna", find_layers(tmp_path, UUID), OtherStores(tmp_path).of(UUID))
    assert list(found.values()) == [OtherLabels("bea", "bea"), OtherLabels("cleo", "cleo")]


def test_stores_of_this_recording_are_found_in_the_folder_for_them_and_in_folders_of_the_command_line(
    tmp_path: Path,
) -> None:
    store, other = make(tmp_path / "made", "anna", "bea"), make(tmp_path / "made", "bea", uuid="rec-2")
    mine, extra = tmp_path / "work", tmp_path / "stick"
    at_hand = put(store, mine / FOLDER / "from bea.sqlite")
    deep = put(store, mine / FOLDER / "bea" / "rec-1" / "labels.sqlite")
    put(other, mine / FOLDER / "bea" / "rec-2" / "labels.sqlite")
    put(store, mine / FOLDER / "a" / "b" / "c" / "too-deep.sqlite")
    put(store, mine / FOLDER / ".hidden.sqlite")
    outside = put(store, extra / "labels.sqlite")
    put(other, extra / "other.sqlite")
    (extra / "browser.sqlite").write_bytes(b"of another program")
    (extra / "recording.h5").write_bytes(b"no store")
    stores = OtherStores(mine, (extra, tmp_path / "nowhere"))
    found = stores.of(UUID)
    assert [(offer.title, offer.path) for offer in found] == [
        (f"anna in {FOLDER}/bea/rec-1/labels.sqlite", deep),
        (f"bea in {FOLDER}/bea/rec-1/labels.sqlite", deep),
        (f"anna in {FOLDER}/from bea.sqlite", at_hand),
        (f"bea in {FOLDER}/from bea.sqlite", at_hand),
        ("anna in stick/labels.sqlite", outside),
        ("bea in stick/labels.sqlite", outside),
    ]
    assert str(tmp_path) not in " ".join(offer.title for offer in found)
    assert not list(mine.rglob("*-shm")) and not list(mine.rglob("*-wal")), "looking leaves no trace"
    outside.unlink()
    assert len(stores.of(UUID)) == 4, "files come and go"


def test_looking_for_others_makes_no_folder(tmp_path: Path) -> None:
    assert OtherStores(tmp_path).of(UUID) == () and not (tmp_path / FOLDER).exists()


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("damaged", b"SQLite format 3\x00" + b"\xa5" * 8_000, "cannot be read"),
        ("text", b"no database at all, but long enough to look at" * 9, "cannot be read"),
        ("foreign", None, "cannot be read"),
        ("other", b"", "of another recording"),
    ],
)
def test_a_file_that_was_put_there_by_hand_and_is_no_use_says_why_in_one_line(
    tmp_path: Path, name: str, content: bytes | None, why: str
) -> None:
    path = tmp_path / FOLDER / f"{name}.sqlite"
    path.parent.mkdir()
    if name == "other":
        put(make(tmp_path / "made", "bea", uuid="rec-2"), path)
    elif content is None:
        with sqlite3.connect(path) as db:
            db.execute("CREATE TABLE cookies (host TEXT)")
    else:
        path.write_bytes(content)
    (offer,) = OtherStores(tmp_path).of(UUID)
    assert offer == RefusedStore(f"{FOLDER}/{name}.sqlite ({why})", path)
    text = str(refusal(offer, UUID))
    assert "\n" not in text and str(tmp_path) not in text and f"{name}.sqlite" in text


def test_names_of_layers_are_looked_up_once_until_the_file_changes(tmp_path: Path) -> None:
    path = put(make(tmp_path / "made", "bea"), tmp_path / FOLDER / "b.sqlite")
    stores = OtherStores(tmp_path)
    assert [offer.title for offer in stores.of(UUID)] == [f"bea in {FOLDER}/b.sqlite"]
    put(make(tmp_path / "more", "bea", "cleo", "dora", "eve"), path)
    os.utime(path, (4e9, 4e9))  # two writes within a tick of the file system's clock have one time
    assert len(stores.of(UUID)) == 4
    assert {layer.annotator for layer in find_layers(tmp_path / "more")} == {"bea", "cleo", "dora", "eve"}
    assert Layer(UUID, "left", "bea") in find_layers(tmp_path / "made")
