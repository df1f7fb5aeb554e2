"""Bounces, hits and net touches in Label, without a browser: on the disk, taken back, proposed and accepted."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.modes.label.comparison import LabelsOf, compare_labels
from app.modes.label.contacts import (
    ContactSearch,
    contact_by_hand,
    contact_differences,
    contact_marks,
    contacts_html,
    open_proposals,
)
from app.modes.label.label_changes import ShownPicture
from core.cameras import Camera
from core.cameras.presets import stereo_preset
from core.physics import PhysicsConfig
from core.simulation.bodies.rally_flight import draw_flights
from core.simulation.flights import LaunchConfig
from core.simulation.scenes.scene import SceneConfig
from core.simulation.truth import ball_truth, pixel_truths, truth_times
from labels.arrays import label_arrays
from labels.assist import Proposals
from labels.contacts import contacts_of_truth, match_contacts
from labels.model import ContactKind, ContactLabel, PositionSource, Provenance
from labels.store import LabelStore, Layer
from tests.app.modes.label.test_editor import BALL_US, Bench

PROPOSED = ContactLabel(
    t_us=BALL_US + 3_000,
    kind=ContactKind.BOUNCE,
    sigma_us=120.0,
    provenance=Provenance(source=PositionSource.ACCEPTED, detector="refined#1"),
)


def stored(bench: Bench, camera: str = "left") -> tuple[ContactLabel, ...]:
    with LabelStore.read(bench.folder, Layer(bench.recording.uuid, camera, "anna")) as store:
        return store.contacts()


def proposing(bench: Bench, *contacts: ContactLabel) -> None:
    bench.editor.labelling = replace(bench.work, proposed_contacts=contacts)


def compare(bench: Bench, *theirs: ContactLabel) -> None:
    now = bench.work
    mine, bea = LabelsOf("anna", now.here.labels, now.here.arrays), LabelsOf("bea", {}, label_arrays(()), theirs)
    bench.editor.compare_with(compare_labels("left", "bea", mine, bea, now.recording.duration_us))


def test_a_key_marks_a_contact_at_the_shown_time_as_exactly_as_the_window_is_long(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.press("bounce")
    (contact,) = stored(bench)
    assert bench.work.contacts == (contact,)
    assert (contact.t_us, contact.kind) == (BALL_US, ContactKind.BOUNCE)
    assert contact.sigma_us == pytest.approx(2_000 / math.sqrt(12), abs=0.1), "uniform over the window of 2 ms"
    made = contact.provenance
    assert (made.annotator, made.source) == ("anna", PositionSource.BY_HAND)
    assert made.window_us == (BALL_US - 1_000, BALL_US + 1_000)


def test_the_key_of_a_kind_moves_a_near_contact_and_another_changes_its_kind(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.press("bounce")
    bench.look(BALL_US + 4_000)
    bench.press("bounce")
    assert [(one.t_us, one.kind) for one in stored(bench)] == [(BALL_US + 4_000, ContactKind.BOUNCE)]
    bench.press("net")
    assert [(one.t_us, one.kind) for one in stored(bench)] == [(BALL_US + 4_000, ContactKind.NET)]
    bench.look(BALL_US + 40_000)
    bench.press("hit")
    assert [one.kind for one in stored(bench)] == [ContactKind.NET, ContactKind.HIT]
    bench.press(*["undo"] * 3)
    assert [(one.t_us, one.kind) for one in bench.work.contacts] == [(BALL_US, ContactKind.BOUNCE)]


def test_a_contact_is_removed_and_comes_back_with_undo(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.press("hit")
    bench.look(BALL_US + 6_000)
    bench.press("remove_contact")
    assert stored(bench) == () == bench.work.contacts
    bench.press("undo")
    assert [one.kind for one in bench.work.contacts] == [ContactKind.HIT]
    bench.look(BALL_US + 60_000)
    bench.press("remove_contact")
    assert len(stored(bench)) == 1, "one that is 60 ms away is not meant"


def test_a_contact_of_another_camera_is_shown_and_changed_where_it_is(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.press("bounce", "camera")
    bench.look(BALL_US + 2_000)
    bench.press("bounce")
    assert [one.t_us for one in bench.work.contacts] == [BALL_US + 2_000]
    assert [one.t_us for one in stored(bench, "left")] == [BALL_US + 2_000]
    assert "camera left" in bench.notes[-1].text


def test_one_key_accepts_a_proposal_and_goes_to_the_next(bench: Bench) -> None:
    later = replace(PROPOSED, t_us=BALL_US + 50_000, kind=ContactKind.HIT)
    proposing(bench, PROPOSED, later)
    bench.look(BALL_US - 50_000)
    bench.press("accept_contact")
    assert bench.work.t_us == PROPOSED.t_us and bench.work.contacts == (), "first it is looked at"
    bench.press("accept_contact")
    (contact,) = stored(bench)
    assert (contact.t_us, contact.kind, contact.sigma_us) == (PROPOSED.t_us, PROPOSED.kind, PROPOSED.sigma_us)
    made = contact.provenance
    assert (made.source, made.annotator, made.detector) == (PositionSource.ACCEPTED, "anna", "refined#1")
    assert bench.work.t_us == later.t_us and open_proposals(bench.work) == (later,)
    bench.look(contact.t_us + 500)
    bench.press("bounce")
    made = bench.work.contacts[0].provenance
    assert (made.source, made.detector) == (PositionSource.CORRECTED, "refined#1")


def test_a_rejected_proposal_is_remembered_undone_and_not_proposed_by_the_next_run(
    bench: Bench, serve_recording: Path
) -> None:
    later = replace(PROPOSED, t_us=BALL_US + 50_000)
    proposing(bench, PROPOSED, later)
    bench.look(PROPOSED.t_us)
    bench.press("remove_contact")
    assert open_proposals(bench.work) == (later,) and bench.work.t_us == later.t_us and stored(bench) == ()
    again = replace(PROPOSED, t_us=PROPOSED.t_us + 900, provenance=Provenance(detector="auto#2"))
    proposing(bench, again, later)
    assert open_proposals(bench.work) == (later,), "another run finds the same kink a little later"
    bench.press("undo")
    assert open_proposals(bench.work) == (again, later) and bench.work.t_us == PROPOSED.t_us
    bench.press("redo")
    assert open_proposals(bench.work) == (later,)
    reopened = Bench(bench.folder, serve_recording, session="another")
    proposing(reopened, PROPOSED, later)
    assert open_proposals(reopened.work) == (later,)
    reopened.close()


def test_what_was_rejected_can_still_be_marked_by_hand(bench: Bench) -> None:
    proposing(bench, PROPOSED)
    bench.look(PROPOSED.t_us)
    bench.press("remove_contact", "hit")
    assert [(one.t_us, one.kind) for one in stored(bench)] == [(PROPOSED.t_us, ContactKind.HIT)]
    bench.press("undo")
    assert stored(bench) == () and open_proposals(bench.work) == (), "it is rejected again"


def test_another_annotators_contacts_are_seen_beside_ones_own_and_taken_over(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.press("bounce")
    made = Provenance(annotator="bea", source=PositionSource.BY_HAND, made_at_us=7)
    same = ContactLabel(t_us=BALL_US + 900, kind=ContactKind.BOUNCE, provenance=made)
    only = replace(same, t_us=BALL_US + 70_000, kind=ContactKind.NET)
    compare(bench, same, only)
    differences = contact_differences(bench.work)
    assert differences is not None and (differences.conflicts, differences.only_theirs) == ((), (only,))
    assert [(one.t_us, one.proposed) for one in contact_marks(bench.work)] == [(BALL_US, False), (only.t_us, True)]
    shown = contacts_html(bench.work)
    assert "beside bea: 0 differ" in shown and "0 only yours, 1 only bea" in shown and "bea, by hand" in shown
    compare(bench, replace(same, kind=ContactKind.HIT), only)
    differences = contact_differences(bench.work)
    assert differences is not None and len(differences.conflicts) == 1
    bench.look(BALL_US + 10_000)
    bench.press("next_contact")
    assert bench.work.t_us == only.t_us
    bench.press("accept_contact")
    taken = stored(bench)[1]
    assert taken == replace(only, provenance=replace(made, tool=taken.provenance.tool))
    bench.editor.begin_repeat(BALL_US)
    assert contact_differences(bench.work) is None, "not in a second look"


def test_the_next_contact_is_labelled_or_proposed_and_the_last_leads_to_the_first(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.press("net")
    proposing(bench, replace(PROPOSED, t_us=BALL_US + 40_000))
    times = []
    for _ in range(3):
        bench.press("next_contact")
        times.append(bench.work.t_us)
    assert times == [BALL_US + 40_000, BALL_US, BALL_US + 40_000]


def test_in_a_second_look_contacts_are_neither_shown_nor_set(bench: Bench) -> None:
    proposing(bench, PROPOSED)
    bench.editor.begin_repeat(BALL_US)
    bench.press("bounce", "accept_contact")
    assert bench.work.contacts == () and open_proposals(bench.work) == ()


def test_nothing_is_interpolated_across_a_contact(bench: Bench) -> None:
    for step in range(12):
        if step != 6:
            bench.click_truth(BALL_US + step * 2_000)
    bench.look(BALL_US + 12_000)
    bench.press("bounce", "interpolate")
    assert BALL_US + 12_000 not in bench.work.here.labels
    bench.press("remove_contact", "interpolate")
    assert BALL_US + 12_000 in bench.work.here.labels


def test_the_bar_and_the_list_say_what_is_labelled_and_what_is_only_proposed(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.press("hit")
    proposing(bench, replace(PROPOSED, t_us=BALL_US + 40_000))
    assert [(one.kind, one.proposed) for one in contact_marks(bench.work)] == [("hit", False), ("bounce", True)]
    shown = contacts_html(bench.work)
    assert f"data-rallyscope-seek='{BALL_US + 40_000}'" in shown and "1 labelled, 1 proposed" in shown
    assert "anna, by hand" in shown and "proposed by refined" in shown


def test_a_contact_that_was_imported_and_is_moved_is_by_hand() -> None:
    before = replace(PROPOSED, provenance=Provenance(source=PositionSource.IMPORTED, detector="file.csv"))
    made = contact_by_hand(ContactKind.HIT, before, ShownPicture(1_000, (0, 2_000), "polarity", 5)).provenance
    assert (made.source, made.detector) == (PositionSource.BY_HAND, "")


def test_contacts_are_found_while_the_detector_goes_on_as_they_are_at_once() -> None:
    cameras: Mapping[str, Camera] = stereo_preset("side")
    scene, launch = SceneConfig(cast="rally"), LaunchConfig(speed_mps=5.0)
    path, _ = draw_flights(scene, [launch], np.random.default_rng(3), PhysicsConfig())
    end_us, window_us, search = 3_000_000, 4_000, ContactSearch(cameras, 0)
    parts = {}
    for name, truth in pixel_truths(cameras, path, np.arange(0, end_us, window_us)).items():
        seen, unknown = truth.visible, np.full((len(truth.t_us), 3), np.nan)
        x, y, r = truth.u_px, truth.v_px, truth.r_px
        parts[name] = Proposals(truth.t_us, x, y, r, unknown, window_us, "trial#1").rows(seen)
    found = None
    for start_us in range(0, end_us, 100_000):
        chunk = {name: part.between(start_us, start_us + 100_000) for name, part in parts.items()}
        answer = search.add(chunk, start_us + 100_000, last=start_us + 100_000 == end_us)
        found = found if answer is None else answer
    truth = contacts_of_truth(ball_truth(path, truth_times(path, 0, end_us)))
    assert found and len(match_contacts(found, truth, 1_000)) == len(found) >= 3
