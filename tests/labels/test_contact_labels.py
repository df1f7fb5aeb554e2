from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.errors import LabelError
from core.physics.config import Profile
from core.physics.episode import Serves
from core.physics.task import task_profile
from core.recordings.truth import BallTruth
from core.simulation.episodes.episode_path import trace_episode
from labels.contacts import (
    contacts_of_truth,
    find_contact_conflicts,
    match_contacts,
    measure_contact_agreement,
    new_contacts,
    score_contacts,
)
from labels.merging import merge_stores
from labels.model import ContactKind, ContactLabel, Label, LabelState, PositionSource, Provenance
from labels.store import LabelStore, Layer
from labels.store_contents import read_store

OLD = Path(__file__).parents[1] / "fixtures" / "label-stores" / "version-2.sqlite"
BOUNCE, HIT, NET = ContactKind


def contact(t_us: int, kind: ContactKind = BOUNCE, sigma_us: float | None = None, made_at_us: int = 5) -> ContactLabel:
    return ContactLabel(t_us=t_us, kind=kind, sigma_us=sigma_us, provenance=Provenance(made_at_us=made_at_us))


def ball(t_us: int) -> Label:
    return Label(t_us=t_us, state=LabelState.VISIBLE, x_px=1.0, y_px=2.0)


def times(store: LabelStore) -> list[int]:
    return [one.t_us for one in store.contacts()]


def test_a_contact_comes_back_with_everything_it_says(tmp_path: Path) -> None:
    made = Provenance(source=PositionSource.CORRECTED, detector="auto#1", window_us=(0, 9), time_spent_ms=7)
    with LabelStore.open(tmp_path, "rec", "left", "anna", tool="t") as store:
        store.edit(put_contacts=[ContactLabel(t_us=70, kind=NET, sigma_us=12.5, provenance=made)])
    with LabelStore.read(tmp_path, Layer("rec", "left", "anna")) as store:
        (found,) = store.contacts()
    assert (found.t_us, found.kind, found.sigma_us) == (70, NET, 12.5)
    assert (found.provenance.annotator, found.provenance.tool) == ("anna", "t") and found.provenance.made_at_us > 0
    assert replace(found.provenance, annotator="", tool="", made_at_us=0) == made


@pytest.mark.parametrize("values", [{"t_us": -1}, {"sigma_us": -1.0}, {"sigma_us": float("nan")}])
def test_an_impossible_contact_is_refused(values: dict) -> None:
    with pytest.raises(LabelError, match="contact at"):
        ContactLabel(**{"t_us": 1, "kind": HIT, **values})


def test_undo_and_redo_cover_contacts_and_labels_alike(tmp_path: Path) -> None:
    with LabelStore.open(tmp_path, "rec", "left", "anna") as store:
        store.put(ball(5))
        store.edit(put=[ball(6)], put_contacts=[contact(6)])
        store.edit(put_contacts=[contact(8, HIT)], delete_contacts=[6])
        assert times(store) == [8] and store.labels().t_us.tolist() == [5, 6]
        assert set(store.undo()) == {6, 8} and times(store) == [6]
        assert store.undo() == (6, 6) and times(store) == [] and store.labels().t_us.tolist() == [5]
        store.redo()
        assert times(store) == [6] and store.labels().t_us.tolist() == [5, 6]
        assert store.edit(delete_contacts=[999]) == 0
        with pytest.raises(LabelError, match="two things about the same time"):
            store.edit(put_contacts=[contact(1)], delete_contacts=[1])


def test_a_rejection_is_no_contact_and_a_step_of_undo(tmp_path: Path) -> None:
    with LabelStore.open(tmp_path, "rec", "left", "anna") as store:
        store.edit(reject_contacts=[contact(70, HIT)])
        assert (store.contacts(), store.rejected_contacts()) == ((), (70,))
        assert store.edit(delete_contacts=[70]) == 0 and store.rejected_contacts() == (70,)
        store.undo()
        assert store.rejected_contacts() == ()
        store.redo()
        store.edit(put_contacts=[contact(70)])
        assert times(store) == [70] and store.rejected_contacts() == ()
        store.undo()
        assert times(store) == [] and store.rejected_contacts() == (70,)
        with pytest.raises(LabelError, match="two things about the same time"):
            store.edit(put_contacts=[contact(1)], reject_contacts=[contact(1)])
        path = store.path
    assert read_store(path).contacts[Layer("rec", "left", "anna")] == ()
    with LabelStore.read(tmp_path, Layer("rec", "left", "anna")) as store:
        assert store.rejected_contacts() == (70,)


def test_undo_leaves_a_contact_that_another_session_has_changed_since(tmp_path: Path) -> None:
    with (
        LabelStore.open(tmp_path, "rec", "left", "anna", session="a") as one,
        LabelStore.open(tmp_path, "rec", "left", "anna", session="b") as other,
    ):
        before = one.version
        one.edit(put_contacts=[contact(6)])
        other.edit(put_contacts=[contact(6, HIT)])
        assert one.version > before and one.contacts()[0].kind is HIT, "what others write is seen"
        step = one.step_back()
        assert step.left_us == (6,) and step.touched_us == () and one.contacts()[0].kind is HIT


def test_a_store_of_version_2_is_read_as_it_is_and_takes_contacts_once_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "rec-2" / "labels.sqlite"
    path.parent.mkdir()
    shutil.copyfile(OLD, path)
    layer = Layer("rec-2", "left", "anna")
    with LabelStore.read(tmp_path, layer, follow=True) as reader:
        assert reader.contacts() == () and reader.labels().x_px[0] == 5.5
        assert read_store(path).contacts == {layer: ()}
        assert path.read_bytes() == OLD.read_bytes(), "a look writes nothing"
        with LabelStore.open(tmp_path, "rec-2", "left", "anna") as store:
            assert store.labels().t_us.tolist() == [1000, 2000]
            store.edit(put_contacts=[contact(1500)])
            assert times(reader) == [1500], "a reader from before the new tables follows"
            store.undo()
            store.undo()
            assert times(store) == [] and store.at(1000).x_px == 5.0  # type: ignore[union-attr]
    merged = merge_stores([OLD], tmp_path / "new.sqlite")
    assert (merged.labels, merged.contacts) == (2, 0)


def test_merging_lists_contacts_in_conflict_and_keeps_the_later_word_of_one_person(tmp_path: Path) -> None:
    def make(folder: str, annotator: str, *contacts: ContactLabel) -> Path:
        with LabelStore.open(tmp_path / folder, "rec", "left", annotator) as store:
            store.edit(put_contacts=contacts)
            return store.path

    one = make("a", "anna", contact(100_000), contact(200_000, HIT), contact(300_000), contact(500_000))
    two = make("b", "anna", contact(100_400, made_at_us=9))
    make("b", "bea", contact(200_100, BOUNCE), contact(303_000), contact(400_000, NET), contact(500_900))
    merged = merge_stores([one, two], tmp_path / "c.sqlite")
    assert [(one.annotators, one.times_us, one.kinds) for one in merged.contact_conflicts] == [
        (("anna", "bea"), (200_000, 200_100), ("hit", "bounce")),
        (("anna", "bea"), (300_000, 303_000), ("bounce", "bounce")),
    ]
    found = read_store(tmp_path / "c.sqlite").contacts
    assert {layer.annotator: [one.t_us for one in those] for layer, those in found.items()} == {
        "anna": [100_400, 500_000],
        "bea": [400_000, 500_900],
    }
    assert (merged.contacts, merged.superseded) == (4, 1)
    merge_stores([one, two], tmp_path / "d.sqlite", prefer="bea")
    assert [len(those) for those in read_store(tmp_path / "d.sqlite").contacts.values()] == [2, 4]


def test_each_contact_is_matched_once_the_nearest_first() -> None:
    first, second = [contact(0), contact(3_000)], [contact(2_000), contact(40_000)]
    assert match_contacts(first, second) == ((1, 0),)
    assert match_contacts(second, first) == ((0, 1),)
    assert match_contacts([], second) == ()
    assert new_contacts(first, second) == (first[0],)
    assert new_contacts(first, [first[0]], replace=True) == (first[1],)


def test_agreement_and_score_have_known_values() -> None:
    mine = [contact(0), contact(100_000, HIT), contact(200_000), contact(300_000)]
    theirs = [contact(200), contact(99_000, HIT), contact(200_600, HIT), contact(900_000)]
    found = measure_contact_agreement(mine, theirs)
    assert (found.common, found.only_first, found.only_second, found.same_kind) == (3, 1, 1, 2)
    assert (found.time.median_us, found.time.bias_us) == (600, 200)
    assert {kind: time.median_us for kind, time in found.by_kind.items()} == {"bounce": 200, "hit": 1000}
    assert found.confusion["bounce"]["hit"] == 1
    rows = {row.kind: row for row in score_contacts(theirs, mine)}
    assert (rows["all"].precision, rows["all"].recall, rows["all"].time.bias_us) == (0.75, 0.75, 200)
    assert rows["bounce"].recall == pytest.approx(1 / 3) and rows["hit"].precision == 0.5 and "net" not in rows
    (nothing,) = score_contacts([], [])
    assert np.isnan(nothing.precision) and np.isnan(nothing.time.median_us)
    assert find_contact_conflicts("left", ("a", "b"), (mine, mine)) == ()


@pytest.mark.parametrize("profile", ["paper", "real"])
def test_a_touch_of_the_net_in_a_simulated_path_is_a_contact_of_its_truth(profile: Profile) -> None:
    launch = Serves(np.array([[1.0, 0.0, 0.15]]), np.array([[-5.0, 0.3, 0.0]]), np.zeros((1, 3)))
    path = trace_episode(launch, None, task_profile(profile), duration_s=1.0)
    t_us = np.arange(0, round(path.end_s * 1e6), 500)
    states = path.at(t_us * 1e-6)
    truth = BallTruth(t_us, states[:, :3], states[:, 3:6], states[:, 6:], np.ones(len(t_us), np.bool_))
    found = contacts_of_truth(truth)
    assert [one.kind for one in found][:3] == [BOUNCE, NET, BOUNCE]
    assert [one.t_us for one in found] == pytest.approx([1e6 * one.t_s for one in path.events[1:]], abs=2)


def test_contacts_of_the_truth_are_where_the_path_turns() -> None:
    """Samples every 500 us of straight lines: a bounce, a net touch, a hit, and the floor, which is none."""
    turns = [
        (0.0101234, (-1.0, 0.0, 0.02), (4, 0, -3), (3, 0, 2.5), BOUNCE),
        (0.2, (0.02, 0.1, 0.16), (5, 0, 0), (2, 0.5, -1), NET),
        (0.4007, (1.6, 0.3, 0.3), (4, 0, 1), (-9, 1, 2), HIT),
        (0.6, (2.5, 0.3, -0.74), (4, 0, -3), (4, 0, 2), None),
    ]
    t_us = np.concatenate([np.arange(-10, 10) * 500 + round(at * 2000) * 500 for at, *_ in turns])
    p, v = [], []
    for at, place, before, after, _ in turns:
        for t in np.arange(-10, 10) * 500 + round(at * 2000) * 500:
            velocity = np.array(before if t * 1e-6 < at else after, float)
            p.append(np.array(place) + velocity * (t * 1e-6 - at))
            v.append(velocity)
    truth = BallTruth(t_us, np.array(p), np.array(v), np.zeros((len(p), 3)), np.ones(len(p), np.bool_))
    found = [(one.t_us, one.kind) for one in contacts_of_truth(truth)]
    assert found == [(10_123, BOUNCE), (200_000, NET), (400_700, HIT)]
    none = np.zeros((0, 3))
    assert contacts_of_truth(BallTruth(t_us[:0], none, none, none, np.zeros(0, np.bool_))) == ()
