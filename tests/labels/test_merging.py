from __future__ import annotations

import time
from pathlib import Path

import pytest

from core.errors import LabelError
from labels.merging import merge_stores
from labels.model import ContactKind, ContactLabel, Label, LabelState, Provenance
from labels.store import LabelStore, Layer, find_layers

UUID = "rec"


def ball(t_us: int, x: float, state: LabelState = LabelState.VISIBLE, made_at_us: int = 5) -> Label:
    return Label(t_us=t_us, state=state, x_px=x, y_px=0.0, provenance=Provenance(made_at_us=made_at_us))


def make(
    folder: Path, annotator: str, *labels: Label, uuid: str = UUID, camera: str = "left", blind: bool = False
) -> Path:
    with LabelStore.open(folder, uuid, camera, annotator, blind=blind) as store:
        store.edit(put=labels)
        return store.path


@pytest.fixture
def stores(tmp_path: Path) -> tuple[Path, Path]:
    nothing = Label(t_us=4, state=LabelState.NO_BALL, provenance=Provenance(made_at_us=5))
    one = make(tmp_path / "a", "anna", ball(1, 10.0), ball(2, 10.0), ball(3, 10.0), nothing)
    make(tmp_path / "a", "anna", ball(1, 90.0), camera="right")
    make(tmp_path / "a", "anna", ball(2, 77.0), blind=True)
    two = make(tmp_path / "b", "bea", ball(1, 11.9), ball(2, 12.1), ball(4, 10.0), ball(9, 10.0))
    return one, two


def labels_of(path: Path, annotator: str, camera: str = "left", *, blind: bool = False) -> list[int]:
    """Times in a merged store, which is put where a store of a folder of labels is."""
    home = path.parent / "home" / UUID / "labels.sqlite"
    home.parent.mkdir(parents=True, exist_ok=True)
    home.write_bytes(path.read_bytes())
    return LabelStore.read(path.parent / "home", Layer(UUID, camera, annotator, blind)).labels().t_us.tolist()


def test_what_annotators_disagree_about_is_listed_and_the_rest_is_merged(
    stores: tuple[Path, Path], tmp_path: Path
) -> None:
    out = tmp_path / "c.sqlite"
    merged = merge_stores(stores, out)
    assert [(c.camera, c.t_us, c.annotators, c.states) for c in merged.conflicts] == [
        ("left", 2, ("anna", "bea"), ("visible", "visible")),
        ("left", 4, ("anna", "bea"), ("no_ball", "visible")),
    ]
    assert merged.conflicts[0].distance_px == pytest.approx(2.1) and merged.conflicts[1].distance_px is None
    assert labels_of(out, "anna") == [1, 3] and labels_of(out, "bea") == [1, 9]
    assert labels_of(out, "anna", "right") == [1] and labels_of(out, "anna", blind=True) == [2]
    assert (merged.labels, merged.left_out, merged.superseded) == (6, 4, 0)
    assert sorted(path.name for path in tmp_path.glob("*c.sqlite*")) == ["c.sqlite"]


def test_how_far_apart_centres_may_be_is_said(stores: tuple[Path, Path], tmp_path: Path) -> None:
    assert [c.t_us for c in merge_stores(stores, tmp_path / "c.sqlite", within_px=1.0).conflicts] == [1, 2, 4]
    assert [c.t_us for c in merge_stores(stores, tmp_path / "d.sqlite", within_px=5.0).conflicts] == [4]


def test_one_annotator_can_be_believed(stores: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "c.sqlite"
    merged = merge_stores(stores, out, prefer="bea")
    assert labels_of(out, "bea") == [1, 2, 4, 9] and labels_of(out, "anna") == [1, 3]
    assert (len(merged.conflicts), merged.left_out) == (2, 2)


def test_of_one_annotator_the_later_word_counts(tmp_path: Path) -> None:
    one = make(tmp_path / "a", "anna", ball(1, 10.0, made_at_us=7), ball(2, 1.0))
    two = make(tmp_path / "b", "anna", ball(1, 50.0, made_at_us=6), ball(2, 1.0))
    for sources in ((one, two), (two, one)):
        out = tmp_path / f"{sources[0].parent.parent.name}.sqlite"
        merged = merge_stores(sources, out)
        assert (merged.labels, merged.superseded, merged.conflicts) == (2, 1, ())
        assert labels_of(out, "anna") == [1, 2]
        assert LabelStore.read(tmp_path / "home", Layer(UUID, "left", "anna")).labels().x_px.tolist() == [10.0, 1.0]


def test_a_folder_of_a_recording_is_a_store_too(stores: tuple[Path, Path], tmp_path: Path) -> None:
    merged = merge_stores([stores[0].parent, stores[1]], tmp_path / "c.sqlite")
    assert (merged.labels, len(merged.conflicts)) == (6, 2)


def test_a_damaged_store_is_saved_by_merging_it_alone(tmp_path: Path) -> None:
    path = make(tmp_path / "a", "anna", *(ball(t, 1.0) for t in range(3000)))
    make(tmp_path / "a", "bea", ball(1, 500.0))
    content = bytearray(path.read_bytes())
    content[40 * 4096 : 41 * 4096] = b"\xa5" * 4096
    path.write_bytes(content)
    merged = merge_stores([path], tmp_path / "new.sqlite")
    assert 1500 < merged.labels < 3001 and "damaged" in merged.notes[0] and merged.conflicts == ()
    with LabelStore.open(tmp_path / "a", "other", "left", "anna"):
        pass  # other recordings are not hurt
    assert len(find_layers(tmp_path / "a", "other")) == 1


def test_what_cannot_be_merged_is_one_clear_line(stores: tuple[Path, Path], tmp_path: Path) -> None:
    other = make(tmp_path / "o", "bea", ball(1, 1.0), uuid="another")
    text = tmp_path / "text.sqlite"
    text.write_text("no database at all, but long enough to look at" * 9)
    out = tmp_path / "c.sqlite"
    for sources, message in (
        ((stores[0], other), "different recordings"),
        ((stores[0], tmp_path / "nowhere"), "no such label store"),
        ((stores[0], text), r"text\.sqlite"),
        ((tmp_path,), "no labels in this folder"),
    ):
        with pytest.raises(LabelError, match=message) as error:
            merge_stores(sources, out)
        assert "\n" not in str(error.value) and not out.exists()
    out.write_text("mine")
    with pytest.raises(LabelError, match="a file already"):
        merge_stores(stores, out)
    assert out.read_text() == "mine"


@pytest.mark.parametrize("in_folders", [True, False])
@pytest.mark.parametrize("order", [1, -1])
def test_what_was_deleted_later_in_another_store_stays_deleted(tmp_path: Path, in_folders: bool, order: int) -> None:
    bounce = ContactLabel(t_us=50, kind=ContactKind.BOUNCE, provenance=Provenance(made_at_us=5))
    one, two = (make(tmp_path / name, "anna", ball(1, 10.0), ball(2, 10.0), ball(3, 10.0)) for name in ("a", "b"))
    for name in ("a", "b"):
        with LabelStore.open(tmp_path / name, UUID, "left", "anna") as store:
            store.edit(put_contacts=[bounce])
    with LabelStore.open(tmp_path / "b", UUID, "left", "anna") as store:
        store.edit(delete=[2], delete_contacts=[50])
        store.edit(delete=[3])
    with LabelStore.open(tmp_path / "a", UUID, "left", "anna") as store:
        later = int(time.time() * 1e6) + 10**9
        store.edit(put=[ball(3, 44.0, made_at_us=later)])  # said again after it was deleted there
    sources = [one, two][::order]
    out = tmp_path / "c.sqlite"
    merged = merge_stores([path.parent if in_folders else path for path in sources], out)
    assert labels_of(out, "anna") == [1, 3]
    assert (merged.labels, merged.contacts, merged.superseded) == (2, 0, 2)


def test_what_a_merge_left_out_was_not_deleted_by_anybody(stores: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "c.sqlite"
    merge_stores(stores, out)
    again = tmp_path / "again.sqlite"
    merge_stores([out, stores[0]], again)
    assert 2 in labels_of(again, "anna") and 4 in labels_of(again, "anna")


def test_whoever_is_preferred_has_labels(stores: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(LabelError, match="no labels by 'Anna'; expected one of anna, bea"):
        merge_stores(stores, tmp_path / "c.sqlite", prefer="Anna")


def test_what_is_no_store_or_unreadable_is_said_without_advising_to_merge_it(tmp_path: Path) -> None:
    table = tmp_path / "labels.csv"
    table.write_text("t_us,state\n" * 50)
    cut = make(tmp_path / "a", "anna", *(ball(t_us, 10.0) for t_us in range(300)))
    cut.write_bytes(cut.read_bytes()[:3000])
    for path, said in ((table, "not a label store"), (cut, "a label store of which nothing can be read")):
        with pytest.raises(LabelError, match=said) as caught:
            merge_stores([path], tmp_path / "out.sqlite")
        assert "merge" not in str(caught.value)
