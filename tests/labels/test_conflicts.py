"""What two people say differently, and what counts as settled: the same for the command and for the app."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from labels.agreement import measure_agreement
from labels.arrays import label_arrays
from labels.conflicts import compare_layers, find_conflicts, how_settled, settled_by, settlement
from labels.merging import merge_stores
from labels.model import Label, LabelState, PositionSource, Provenance
from labels.store import LabelStore, Layer
from labels.store_contents import layers_of_store, read_store

UUID = "rec"
NOTHING = Label(t_us=4, state=LabelState.NO_BALL, provenance=Provenance(made_at_us=5))


def ball(t_us: int, x: float, made_at_us: int = 5, *, settles: str = "") -> Label:
    source = PositionSource.SETTLED if settles else PositionSource.BY_HAND
    made = Provenance(made_at_us=made_at_us, source=source, detector=settles)
    return Label(t_us=t_us, state=LabelState.VISIBLE, x_px=x, y_px=0.0, provenance=made)


def make(folder: Path, annotator: str, *labels: Label, uuid: str = UUID) -> Path:
    with LabelStore.open(folder, uuid, "left", annotator) as store:
        store.edit(put=labels)
        return store.path


def test_layers_differ_in_state_or_by_more_than_they_may() -> None:
    one = label_arrays([ball(1, 10.0), ball(2, 10.0), ball(3, 10.0), NOTHING, ball(5, 1e300)])
    other = label_arrays([ball(2, 12.0), ball(3, 12.01), ball(4, 10.0), ball(5, -1e300), ball(9, 1.0)])
    found = compare_layers(one, other)
    assert found.common_us.tolist() == [2, 3, 4, 5] and found.differ.tolist() == [False, True, True, True]
    assert found.distance_px[:2].tolist() == pytest.approx([2.0, 2.01]) and np.isnan(found.distance_px[2])
    assert not len(compare_layers(one, label_arrays(())).common_us)
    assert compare_layers(one, other, within_px=3.0).differ.tolist() == [False, False, True, True]


def test_a_label_settles_a_conflict_with_the_label_that_it_was_made_over_and_with_no_other() -> None:
    theirs = ball(1, 20.0, made_at_us=7)
    mine = ball(1, 15.0, settles=settlement("bea", theirs, "mean"))
    assert how_settled(mine, "bea", theirs) == "mean"
    assert how_settled(mine, "cleo", theirs) is None
    assert how_settled(mine, "bea", replace(theirs, provenance=Provenance(made_at_us=8))) is None, "bea said more"
    assert how_settled(ball(1, 15.0), "bea", theirs) is None
    assert how_settled(ball(1, 15.0, settles="bea 7: anything"), "bea", theirs) is None
    assert settled_by(("anna", "bea"), (mine, theirs)) == "anna" == settled_by(("bea", "anna"), (theirs, mine))
    odd = "bea 7: mean"  # a name that looks like what we write
    assert how_settled(ball(1, 1.0, settles=settlement(odd, theirs, "new")), odd, theirs) == "new"


def test_of_two_who_both_settled_only_the_one_who_saw_what_the_other_says_now_has() -> None:
    first, second = ball(1, 10.0, made_at_us=1), ball(1, 20.0, made_at_us=2)
    anna = ball(1, 15.0, made_at_us=3, settles=settlement("bea", second, "mean"))
    bea = ball(1, 20.0, made_at_us=4, settles=settlement("anna", first, "mine"))
    assert settled_by(("anna", "bea"), (anna, bea)) is None, "neither had seen the other's"
    again = ball(1, 20.0, made_at_us=5, settles=settlement("anna", anna, "mine"))
    assert settled_by(("anna", "bea"), (anna, again)) == "bea"


def test_conflicts_of_one_store_are_found_between_its_annotators_and_say_who_settled_them(tmp_path: Path) -> None:
    theirs = ball(2, 30.0, made_at_us=9)
    make(tmp_path, "anna", ball(1, 10.0), ball(2, 10.0, settles=settlement("bea", theirs, "mine")), NOTHING)
    path = make(tmp_path, "bea", ball(1, 10.5), theirs, ball(4, 1.0))
    found = find_conflicts(read_store(path).layers)
    assert [(c.t_us, c.annotators, c.states, c.settled_by) for c in found] == [
        (2, ("anna", "bea"), ("visible", "visible"), "anna"),
        (4, ("anna", "bea"), ("no_ball", "visible"), None),
    ]


def test_merging_takes_what_settles_a_conflict_and_lists_the_others(tmp_path: Path) -> None:
    theirs = ball(2, 30.0, made_at_us=9)
    one = make(tmp_path / "a", "anna", ball(2, 20.0, settles=settlement("bea", theirs, "mean")), ball(3, 1.0))
    two = make(tmp_path / "b", "bea", theirs, ball(3, 9.0))
    merged = merge_stores([one, two], tmp_path / "c.sqlite")
    assert [c.t_us for c in merged.conflicts] == [3] and (merged.settled, merged.left_out) == (1, 3)
    kept = read_store(tmp_path / "c.sqlite").layers
    assert [list(kept[Layer(UUID, "left", name)]) for name in ("anna", "bea")] == [[2], []]
    assert merge_stores([one, two], tmp_path / "d.sqlite", prefer="bea").left_out == 2, "anna's mean, and bea's 3"


def test_a_merged_store_still_knows_what_both_said_first_also_after_a_second_merge(tmp_path: Path) -> None:
    """Of seven common labels two are in conflict: one was settled by anna, one is open and left out."""
    theirs = ball(2, 30.0, made_at_us=9)
    same = [ball(t_us, 1.0) for t_us in range(10, 15)]
    one = make(tmp_path / "a", "anna", ball(2, 20.0), ball(3, 1.0), *same)
    with LabelStore.open(tmp_path / "a", UUID, "left", "anna") as store:
        store.put(ball(2, 25.0, made_at_us=12, settles=settlement("bea", theirs, "mean")))
    two = make(tmp_path / "b", "bea", theirs, ball(3, 9.0), *same)
    three = make(tmp_path / "c", "cleo", ball(20, 1.0))
    home = tmp_path / "home" / UUID / "labels.sqlite"
    home.parent.mkdir(parents=True)
    merge_stores([one, two], tmp_path / "d.sqlite")
    merge_stores([tmp_path / "d.sqlite", three], home)
    anna, bea = (LabelStore.read(tmp_path / "home", Layer(UUID, "left", name)) for name in ("anna", "bea"))
    assert len(anna.labels()) == 6 and len(bea.labels()) == 5, "the conflicts are merged as before"
    found = measure_agreement(anna.independent().labels, bea.independent().labels)
    assert found.common == 7 and found.p95_px > 8
    assert anna.independent().labels.x_px[:2].tolist() == [20.0, 1.0]
    assert bea.independent().settled_us.tolist() == [2, 3]


def test_reading_a_store_that_nobody_has_open_leaves_no_trace(tmp_path: Path) -> None:
    path = make(tmp_path, "anna", ball(1, 10.0))
    files = {file: file.read_bytes() for file in path.parent.iterdir()}
    assert len(files) == 1
    assert [layer.annotator for layer in layers_of_store(path)] == ["anna"]
    assert read_store(path).layers[Layer(UUID, "left", "anna")][1].x_px == 10.0
    assert {file: file.read_bytes() for file in path.parent.iterdir()} == files
    path.parent.chmod(0o500)  # a folder that nothing can be made in
    try:
        assert len(read_store(path).layers) == 1
    finally:
        path.parent.chmod(0o700)


def test_a_store_that_somebody_writes_is_read_with_what_is_not_in_the_file_yet(tmp_path: Path) -> None:
    with LabelStore.open(tmp_path, UUID, "left", "anna") as store:
        store.put(ball(1, 10.0))
        assert store.path.with_name("labels.sqlite-wal").stat().st_size
        assert list(read_store(store.path).layers[Layer(UUID, "left", "anna")]) == [1]
        store.put(ball(2, 10.0))
        assert list(read_store(store.path).layers[Layer(UUID, "left", "anna")]) == [1, 2]


def test_what_was_said_before_a_conflict_was_settled_is_still_known(tmp_path: Path) -> None:
    theirs = ball(2, 30.0, made_at_us=9)
    with LabelStore.open(tmp_path, UUID, "left", "anna") as store:
        store.edit(put=[ball(1, 10.0), ball(2, 20.0), ball(3, 7.0)])
        store.put(ball(2, 30.0, settles=settlement("bea", theirs, "theirs")))
        store.put(ball(4, 30.0, settles=settlement("bea", theirs, "theirs")))
        found = store.independent()
        assert (found.labels.t_us.tolist(), found.labels.x_px.tolist()) == ([1, 2, 3], [10.0, 20.0, 7.0])
        assert (found.settled_us.tolist(), found.copied_us.tolist()) == ([2, 4], [])
        assert store.labels().x_px.tolist() == [10.0, 30.0, 7.0, 30.0], "the labels themselves stay settled"
