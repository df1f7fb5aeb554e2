from __future__ import annotations

from pathlib import Path

import pytest

from core.errors import LabelError
from labels.model import Label, LabelState
from labels.store import LabelStore, Layer

LAYER = Layer("u", "left", "anna")
COUNT = 3000
PAGE = 4096


@pytest.fixture
def store_file(tmp_path: Path) -> Path:
    with LabelStore.open(tmp_path, "u", "left", "anna") as store:
        store.edit(put=[Label(t_us=t, state=LabelState.VISIBLE, x_px=1.0, y_px=2.0, r_px=3.0) for t in range(COUNT)])
        return store.path


def overwrite(path: Path, first: int, last: int) -> None:
    content = bytearray(path.read_bytes())
    content[first:last] = b"\xa5" * (last - first)
    path.write_bytes(content)


def test_what_can_be_read_of_a_damaged_store_is_kept_with_a_note(store_file: Path, tmp_path: Path) -> None:
    pages = store_file.stat().st_size // PAGE
    kept = []
    for page in (pages // 3, pages // 2, 2 * pages // 3):
        whole = store_file.read_bytes()
        overwrite(store_file, page * PAGE, (page + 1) * PAGE)
        store = LabelStore.read(tmp_path, LAYER)
        kept.append(len(store.labels()))
        if kept[-1] < COUNT:
            assert "damaged" in store.notes[0] and f"{kept[-1]:,} labels could be read" in store.notes[0]
            with pytest.raises(LabelError, match=r"damaged label store.*labels merge"):
                LabelStore.open(tmp_path, "u", "left", "anna").labels()
        store_file.write_bytes(whole)
    assert min(kept) < COUNT, "the damage must hit labels, or this tests nothing"
    assert min(kept) > COUNT // 2


@pytest.mark.parametrize("size", [0, 50, PAGE // 2, PAGE, 3 * PAGE])
def test_a_store_that_is_cut_off_is_read_as_far_as_it_goes_or_is_one_clear_line(
    store_file: Path, tmp_path: Path, size: int
) -> None:
    store_file.write_bytes(store_file.read_bytes()[:size])
    try:
        store = LabelStore.read(tmp_path, LAYER)
    except LabelError as error:
        said = str(error)
    else:
        assert len(store.labels()) < COUNT
        (said,) = store.notes
    assert "\n" not in said and "labels.sqlite" in said


def test_a_file_that_is_no_database_is_one_clear_line(store_file: Path, tmp_path: Path) -> None:
    overwrite(store_file, 0, 100)
    for act in (
        lambda: LabelStore.read(tmp_path, LAYER),
        lambda: LabelStore.open(tmp_path, "u", "left", "anna"),
    ):
        with pytest.raises(LabelError, match=r"labels\.sqlite"):
            act()
