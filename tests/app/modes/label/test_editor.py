"""A browser's labelling without a browser: everything that a key does, written to the disk and read again."""

import queue
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.cli.main import main
from app.modes.label.contacts import ContactSearch
from app.modes.label.editor import LabelCallbacks, LabelEditor
from app.modes.label.keys import ACTS
from app.modes.label.label_picture import LineMark, PointMark
from app.modes.label.labelling import Labelling, LabelView, begin_labelling
from app.modes.label.plan import LabelScene, PicturePlan, centre_at, plan_at
from app.modes.label.sightings import FROM_OTHERS, agreement_at, draft_at
from app.modes.label.status import agreement_words
from app.modes.label.suggestions import LabelSuggestions, add_proposals
from app.modes.services import LABEL_TOOL
from app.pictures.palette import PaletteIndex
from core.detection import refined_config
from core.detection.saved import SavedDetector
from core.events import Events, SensorSize
from core.recordings import RecordingWriter, open_recording
from labels.assist import Proposals
from labels.formats.exchange import picture_name
from labels.model import LabelState, PositionSource
from labels.store import LabelStore, Layer, find_layers
from labels.store_registry import LabelStoreRegistry
from tests.waiting import eventually

BALL_US = 300_000
DETECTOR = SavedDetector("refined", refined_config())


class Bench:
    """An editor with a loop of its own."""

    def __init__(
        self,
        folder: Path,
        recording: Path,
        cameras: tuple[str, ...] = ("left", "right"),
        *,
        session: str = "browser",
        registry: LabelStoreRegistry | None = None,
    ) -> None:
        from concurrent.futures import ThreadPoolExecutor

        self.folder, self.errors, self.notes = folder, [], []
        self._inbox: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self.recording = open_recording(recording)
        callbacks = LabelCallbacks(
            lambda act: True, self._inbox.put, self.errors.append, self.notes.append, lambda t_us: None
        )
        stores = registry or LabelStoreRegistry(folder, tool=LABEL_TOOL)
        view = LabelView(camera="left", annotator="anna")
        labelling = begin_labelling(self.recording, view, 2000, time.monotonic())
        self.editor = LabelEditor(stores, labelling, callbacks, session)
        self.pool = ThreadPoolExecutor(1)
        self.suggestions = LabelSuggestions(self.editor, self.pool)
        self.wait(lambda: set(cameras) <= set(self.work.saved))

    @property
    def work(self) -> Labelling:
        return self.editor.labelling

    def close(self) -> None:
        self.suggestions.close()
        self.editor.close()
        self.pool.shutdown()
        self.recording.close()

    def wait(self, condition: Callable[[], object] | None = None) -> None:
        """Run the loop until the condition holds, or until nothing is waiting."""

        def turn() -> bool:
            while not self._inbox.empty():
                self._inbox.get()()
            return bool((condition or (lambda: not self.editor.writer.waiting))()) and self._inbox.empty()

        eventually(turn, "what the annotator is to see", lambda: (self.notes, self.errors))

    def scene(self) -> LabelScene:
        return LabelScene(self.work)

    def look(self, t_us: int | None = None) -> PicturePlan:
        """As if the picture at the cursor had been shown."""
        if t_us is not None:
            self.editor.go_to(t_us)
        scene = self.scene()
        plan = plan_at(scene, self.work.t_us, centre_at(scene, self.work.t_us, None))
        self.editor.show(plan)
        return plan

    def press(self, *names: str) -> None:
        for name in names:
            self.look()
            self.editor.do(ACTS[name])
        self.wait()

    def truth(self, t_us: int, camera: str = "left") -> tuple[float, float]:
        truth = self.recording.cameras[camera].truth
        assert truth is not None
        here = truth.at(t_us)
        return float(here.u_px[0]), float(here.v_px[0])

    def click_truth(self, t_us: int, off_px: float = 1.0) -> None:
        self.look(t_us)
        x, y = self.truth(t_us, self.work.view.camera)
        self.editor.place_ball(x + off_px, y)
        self.wait()


@pytest.fixture
def bench(tmp_path: Path, serve_recording: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path / "labels", serve_recording)
    yield bench
    bench.close()


def test_looking_leaves_no_trace(bench: Bench) -> None:
    bench.look(BALL_US)
    assert find_layers(bench.folder) == ()


def test_a_click_is_snapped_and_on_the_disk(bench: Bench) -> None:
    bench.click_truth(BALL_US, off_px=2.0)
    stored = LabelStore.read(bench.folder, Layer(bench.recording.uuid, "left", "anna")).at(BALL_US)
    assert stored is not None and stored == bench.work.here.labels[BALL_US]
    assert (stored.x_px, stored.y_px) == pytest.approx(bench.truth(BALL_US), abs=0.5)
    made = stored.provenance
    assert (made.source, made.window_us, made.rendering) == (PositionSource.SNAPPED, (299_000, 301_000), "polarity")
    assert made.tool.startswith("rallyscope") and made.annotator == "anna"


EMPTY = (12.0, 9.0)
"""A corner of the sensor where nothing happens."""


def test_a_click_where_no_circle_fits_is_not_stored_but_asks_for_a_radius(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.editor.place_ball(*EMPTY)
    bench.wait(lambda: bench.work.asking)
    assert "no circle fits here: drag to set the radius, or press X for no ball" in bench.work.asking.question
    assert not bench.work.here.labels and not bench.errors
    marks = bench.look().main.marks
    assert [(mark.x_px, mark.y_px, mark.r_px, mark.ink) for mark in marks] == [(*EMPTY, None, PaletteIndex.ASKS)]
    stored = LabelStore.read(bench.folder, Layer(bench.recording.uuid, "left", "anna"))
    assert stored.all() == () and stored.version == 0
    bench.editor.place_ball(*EMPTY, 6.5)
    bench.wait()
    assert bench.work.here.labels[BALL_US].r_px == 6.5 and bench.work.asking is None


@pytest.mark.parametrize(
    ("answer", "state", "r_px"),
    [
        ("no_ball", LabelState.NO_BALL, None),
        ("larger", LabelState.VISIBLE, 5.25),
        ("smaller", LabelState.VISIBLE, 4.75),
    ],
)
def test_a_click_without_a_circle_is_answered_by_a_key(
    bench: Bench, answer: str, state: LabelState, r_px: float | None
) -> None:
    bench.look(BALL_US)
    bench.editor.place_ball(*EMPTY)
    bench.wait(lambda: bench.work.asking)
    bench.editor.do(ACTS[answer])
    bench.wait()
    label = bench.work.here.labels[BALL_US]
    assert (label.state, label.r_px) == (state, r_px) and bench.work.click is None


def test_a_click_without_a_circle_is_forgotten_by_escape_or_by_going_elsewhere(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.editor.place_ball(*EMPTY)
    bench.wait(lambda: bench.work.asking)
    bench.press("escape")
    assert bench.work.asking is None
    bench.editor.place_ball(*EMPTY)
    bench.wait(lambda: bench.work.asking)
    bench.press("next")
    assert bench.work.asking is None and not bench.work.here.labels


def test_going_on_after_each_click_comes_back_to_one_without_a_circle(bench: Bench) -> None:
    bench.editor.change_view({"advance": True})
    bench.look(BALL_US)
    bench.editor.place_ball(*EMPTY)
    assert bench.work.t_us == BALL_US + 2000
    bench.wait(lambda: bench.work.asking)
    assert bench.work.t_us == BALL_US


def test_without_snapping_the_first_click_asks_too_and_later_ones_keep_the_radius(bench: Bench) -> None:
    bench.editor.change_view({"snap": False})
    bench.look(BALL_US)
    bench.editor.place_ball(50.0, 60.0)
    bench.wait(lambda: bench.work.asking)
    assert bench.work.asking.question.startswith("how large is it?")
    bench.editor.place_ball(50.0, 60.0, 7.0)
    bench.editor.place_ball(52.0, 61.0)
    bench.wait()
    label = bench.work.here.labels[BALL_US]
    assert (label.x_px, label.y_px, label.r_px) == (52.0, 61.0, 7.0)


@pytest.mark.parametrize("r_px", [None, 3.5])
def test_numbers_that_are_typed_in_need_a_radius_above_0(bench: Bench, r_px: float | None) -> None:
    bench.look(BALL_US)
    bench.editor.set_numbers(20.0, 30.0, r_px)
    bench.wait()
    assert (BALL_US in bench.work.here.labels) == (r_px is not None)
    if r_px is None:
        assert "needs a radius" in str(bench.errors[0])
    else:
        bench.editor.set_numbers(21.0, 30.0, None)
        bench.wait()
        assert bench.work.here.labels[BALL_US].x_px == 20.0 and "needs a radius" in str(bench.errors[0])


def test_two_browsers_of_one_annotator_see_each_other_and_undo_only_what_is_theirs(
    tmp_path: Path, serve_recording: Path
) -> None:
    registry = LabelStoreRegistry(tmp_path / "labels")
    one, two = (Bench(tmp_path / "labels", serve_recording, session=name, registry=registry) for name in "ab")
    two.click_truth(BALL_US + 4000)
    one.click_truth(BALL_US)
    two.editor.look_again(time.monotonic() + 9.0)
    two.wait(lambda: BALL_US in two.work.here.labels)
    two.press("undo")
    assert sorted(two.work.here.labels) == [BALL_US]
    two.press("undo")
    assert sorted(two.work.here.labels) == [BALL_US] and two.notes[-1].title == "Nothing to undo"
    two.look(BALL_US)
    two.press("right")
    one.press("undo")
    assert one.notes[-1].title == "Undo: left as it is" and "Somebody else has changed" in one.notes[-1].text
    assert BALL_US in one.work.here.labels
    for bench in (one, two):
        bench.close()


def test_nudges_in_quick_succession_all_count(bench: Bench) -> None:
    bench.click_truth(BALL_US)
    before = bench.work.here.labels[BALL_US]
    bench.press("right", "right", "down_more", "larger", "left", "right")
    after = bench.work.here.labels[BALL_US]
    assert before.x_px and before.y_px and before.r_px
    assert (after.x_px, after.y_px, after.r_px) == pytest.approx(
        (before.x_px + 0.5, before.y_px + 1, before.r_px + 0.25)
    )


def test_a_key_that_has_nothing_to_change_says_so(bench: Bench) -> None:
    bench.press("right")
    assert len(bench.errors) == 1 and "click the ball first" in str(bench.errors[0])
    bench.press("copy")
    assert "no label before" in str(bench.errors[1])


def test_undo_goes_back_to_nothing_and_redo_forth_again(bench: Bench) -> None:
    bench.click_truth(BALL_US)
    bench.press("right", "next", "copy", "partly", "next", "no_ball")
    labels = dict(bench.work.here.labels)
    assert [labels[BALL_US + 2000 * k].state for k in range(3)] == [
        LabelState.VISIBLE, LabelState.PARTLY_OCCLUDED, LabelState.NO_BALL,
    ]  # fmt: skip
    bench.press(*["undo"] * 6)
    assert dict(bench.work.here.labels) == {} and not bench.work.saved["left"].can_undo
    bench.press(*["redo"] * 6)
    assert dict(bench.work.here.labels) == labels


def test_what_is_not_on_the_screen_is_not_accepted(bench: Bench) -> None:
    propose(bench, BALL_US)
    bench.look(BALL_US)
    bench.editor.do(ACTS["accept"])
    bench.editor.do(ACTS["accept"])  # the cursor is further, the picture is not
    bench.wait()
    assert sorted(bench.work.here.labels) == [BALL_US]


@pytest.mark.parametrize("key", ["accept", "reject"])
def test_a_proposal_outside_the_zoomed_picture_is_shown_before_it_is_judged(bench: Bench, key: str) -> None:
    propose(bench, BALL_US)
    bench.editor.change_view({"zoom": 10.0})
    bench.editor.go_to(BALL_US)
    draft = draft_at(bench.work, BALL_US)
    assert draft is not None
    away = plan_at(bench.scene(), BALL_US, (draft.x_px + 200.0, draft.y_px))  # it came after this was drawn
    bench.editor.show(away)
    for _ in range(2):  # a key that is held
        bench.editor.do(ACTS[key])
    bench.wait()
    assert not bench.work.here.labels and draft_at(bench.work, BALL_US) == draft and bench.work.t_us == BALL_US
    assert [note.title for note in bench.notes] == ["Not judged yet"]
    bench.editor.show(plan_at(bench.scene(), BALL_US, centre_at(bench.scene(), BALL_US, None)))
    bench.editor.do(ACTS[key])
    bench.wait()
    assert (BALL_US in bench.work.here.labels) == (key == "accept") and bench.work.here.draft(BALL_US) != draft


def test_a_rejected_proposal_is_gone_and_the_time_stays_unchecked(bench: Bench) -> None:
    propose(bench, BALL_US)
    assert bench.work.here.draft(BALL_US) is not None
    bench.look(BALL_US)
    bench.press("reject")
    assert bench.work.here.draft(BALL_US) is None and not bench.work.here.labels
    stored = LabelStore.read(bench.folder, Layer(bench.recording.uuid, "left", "anna"))
    assert bench.work.here.proposals is not None
    assert stored.rejected() == {(BALL_US, bench.work.here.proposals.detector)} == bench.work.saved["left"].rejected


def test_proposals_of_both_cameras_come_together(bench: Bench) -> None:
    bench.editor.go_to(BALL_US)
    bench.suggestions.toggle_propose(DETECTOR)
    bench.wait(lambda: any(work.proposals is not None for work in bench.work.works.values()))
    assert all(work.proposals is not None for work in bench.work.works.values())


def test_a_segment_without_proposals_says_so(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.editor.do(ACTS["accept_segment"])
    assert [note.title for note in bench.notes] == ["No proposals here"]


def test_a_segment_is_accepted_as_one_step(bench: Bench) -> None:
    propose(bench, BALL_US)
    bench.look(BALL_US)
    bench.editor.do(ACTS["accept_segment"])
    bench.wait()
    labels = bench.work.here.labels
    assert len(labels) > 20 and {label.provenance.source for label in labels.values()} == {PositionSource.ACCEPTED}
    truth = {t_us: bench.truth(t_us) for t_us in labels}
    assert max(abs((label.x_px or 0) - truth[t][0]) for t, label in labels.items()) < 2.0
    assert [(one.title, one.text.split()[0]) for one in bench.notes] == [("Segment accepted", str(len(labels)))]
    bench.look(BALL_US)
    bench.editor.do(ACTS["accept_segment"])
    bench.wait()
    assert bench.notes[-1].title == "Nothing to accept" and bench.work.here.labels == labels
    bench.press("undo")
    assert not bench.work.here.labels


def test_the_queue_of_a_camera_without_labels_and_proposals_finds_nothing_right(bench: Bench) -> None:
    bench.suggestions.next_suspicious()
    bench.wait(lambda: bench.notes)
    assert [(note.title, note.colour) for note in bench.notes] == [("Nothing to check", "yellow")]


@pytest.mark.gate
def test_a_whole_flight_is_accepted_in_both_cameras_and_leads_to_what_is_doubted(bench: Bench) -> None:
    propose(bench, BALL_US)
    bench.wait(lambda: bench.suggestions.share is None)  # it would put its own proposal over the wrong one
    proposals = bench.work.here.proposals
    assert proposals is not None
    wrong = np.flatnonzero((proposals.t_us > BALL_US + 20_000) & (proposals.t_us % 2000 == 0))[0]
    wrong_us = int(proposals.t_us[wrong])
    x_px = proposals.x_px.copy()
    x_px[wrong] += 9.0
    add_proposals(bench.editor, {"left": replace(proposals, x_px=x_px)})
    bench.look(BALL_US)
    bench.suggestions.take_flight()
    bench.wait(lambda: bench.notes)
    bench.wait()
    assert bench.notes[-1].title == "Flight accepted"
    for camera in ("left", "right"):
        labels = bench.work.works[camera].labels
        assert len(labels) > 40, camera
        errors = [
            np.hypot((label.x_px or 0) - u, (label.y_px or 0) - v)
            for t_us, label in labels.items()
            for u, v in [bench.truth(t_us, camera)]
        ]
        assert np.nanpercentile(errors, 95) < 1.0
        assert LabelStore.read(bench.folder, Layer(bench.recording.uuid, camera, "anna")).all() != ()
    assert wrong_us not in bench.work.here.labels
    assert bench.work.t_us == wrong_us and re.match(r"(8|9)\.\d px off the flight", bench.suggestions.reason)
    in_right = dict(bench.work.works["right"].labels)
    bench.press("undo")
    assert not bench.work.here.labels and not bench.work.works["right"].labels
    bench.press("redo")
    assert bench.work.here.labels and bench.work.works["right"].labels == in_right


def test_a_flight_that_is_none_says_so_and_labels_nothing(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.suggestions.take_flight()
    bench.wait(lambda: bench.notes)
    assert [note.title for note in bench.notes] == ["No proposals here"]
    propose(bench, BALL_US)
    bench.wait(lambda: bench.suggestions.share is None)
    still = {
        name: replace(work.proposals, x_px=np.full(len(work.proposals), 100.0), y_px=np.full(len(work.proposals), 90.0))
        for name, work in bench.work.works.items()
        if work.proposals is not None
    }
    add_proposals(bench.editor, still)
    bench.look(BALL_US)
    bench.suggestions.take_flight()
    bench.wait(lambda: len(bench.notes) == 2)
    assert bench.notes[-1].title == "No flight here"
    assert not any(work.labels for work in bench.work.works.values())


def test_labels_between_keyframes_are_interpolated_in_space_where_both_cameras_are_labelled(bench: Bench) -> None:
    times = range(BALL_US, BALL_US + 81_000, 10_000)
    for camera in ("right", "left"):
        bench.editor.change_view({"camera": camera})
        for t_us in times:
            bench.click_truth(t_us)
    bench.editor.go_to(BALL_US + 6_000)
    bench.editor.do(ACTS["interpolate"])
    bench.wait()
    labels = bench.work.here.labels
    between = {t: label for t, label in labels.items() if label.provenance.source is PositionSource.INTERPOLATED}
    assert len(between) == 4 * 8 and {label.provenance.detector for label in between.values()} == {"flight"}
    errors = [abs((label.x_px or 0) - bench.truth(t)[0]) for t, label in between.items()]
    assert max(errors) < 1.0


def test_the_cameras_agree_on_the_same_ball_and_not_on_another(bench: Bench) -> None:
    for camera in ("right", "left"):
        bench.editor.change_view({"camera": camera})
        bench.click_truth(BALL_US)
    good = agreement_at(bench.work, BALL_US)
    assert good is not None and good.residual_px < 0.6
    bench.press(*["down_more"] * 8)
    bad = agreement_at(bench.work, BALL_US)
    assert bad is not None and bad.residual_px > 2.5


def test_the_queue_leads_to_the_label_that_is_wrong(bench: Bench) -> None:
    for t_us in range(BALL_US, BALL_US + 30_000, 2000):
        bench.click_truth(t_us)
    wrong = BALL_US + 14_000
    bench.look(wrong)
    bench.press(*["down_more"] * 9)
    bench.look(BALL_US)
    bench.suggestions.next_suspicious()
    bench.wait(lambda: bench.suggestions.reason)
    assert bench.work.t_us == wrong and "neighbours" in bench.suggestions.reason
    doubted = bench.work.here.labels[wrong]
    assert bench.suggestions.reason_for(doubted) == bench.suggestions.reason
    bench.press("up_more")
    corrected = bench.work.here.labels[wrong]
    assert corrected != doubted and bench.suggestions.reason_for(corrected) == "", "it spoke of the label before"


def test_a_second_look_goes_to_a_layer_of_its_own(bench: Bench) -> None:
    for t_us in range(0, 600_000, 2000):  # one in twenty of 280: none at all is unthinkable
        bench.look(t_us)
        bench.editor.set_state(LabelState.OUT_OF_FRAME)
    bench.wait()
    bench.suggestions.repeat_annotation()
    bench.wait(lambda: bench.work.view.repeat or bench.notes)
    assert bench.work.view.repeat
    asked = bench.work.t_us
    assert bench.look().main.marks == ()
    bench.editor.set_state(LabelState.NO_BALL)
    bench.wait(lambda: not bench.work.view.repeat)
    second = LabelStore.read(bench.folder, Layer(bench.recording.uuid, "left", "anna", blind=True))
    label = second.at(asked)
    assert label is not None and label.state is LabelState.NO_BALL
    assert bench.work.here.labels[asked].state is LabelState.OUT_OF_FRAME


def test_a_short_recording_is_gone_through_in_steps_that_tell_how_far_it_is(bench) -> None:
    shares: list[float] = []
    streams = [bench.work.source.stream]
    contacts = ContactSearch(bench.work.rig, 0)
    bench.suggestions._propose(streams, (0, 120_000), DETECTOR, contacts, shares.append, lambda: False)
    bench.wait()
    assert len(shares) >= 6 and shares == sorted(shares) and shares[-1] == 1.0


def propose(bench: Bench, t_us: int) -> None:
    """Until the detector has been through 100 ms from there."""
    bench.editor.go_to(t_us)
    bench.suggestions.toggle_propose(DETECTOR)
    bench.wait(lambda: bench.suggestions.share is None or bench.suggestions.share > 0.3)
    if bench.suggestions.share is not None:
        bench.suggestions.toggle_propose(DETECTOR)


def test_frames_are_labelled_at_their_own_times_and_exposures_and_exported(tmp_path: Path) -> None:
    file = tmp_path / "both.h5"
    sensor = SensorSize(64, 48)
    with RecordingWriter(file, {"left": sensor, "rgb": sensor}, seed=1) as writer:
        writer.append("left", Events.from_columns([0, 50_000], [1, 2], [3, 4], [True, False], sensor))
        images = np.full((3, 48, 64, 3), 90, np.uint8)
        images[1, 20, 30] = (255, 0, 0)
        writer.write_frames("rgb", np.array([9_000, 19_000, 29_000]), np.full(3, 4_000), images)
    bench = Bench(tmp_path / "data" / "labels", file, cameras=("left", "rgb"))
    bench.editor.change_view({"camera": "rgb"})
    assert bench.work.others == ()
    bench.editor.step(+1)
    bench.editor.step(+1)
    assert bench.work.t_us == 19_000
    plan = bench.look()
    assert (plan.main.frame, plan.main.window_us) == (1, (17_000, 21_000))
    bench.editor.place_ball(30.25, 20.5, 4.0)
    bench.wait()
    label = bench.work.here.labels[19_000]
    assert (label.x_px, label.y_px, label.provenance.source) == (30.25, 20.5, PositionSource.BY_HAND)
    assert (label.provenance.rendering, label.provenance.window_us) == ("frame", (17_000, 21_000))
    bench.close()
    out = tmp_path / "out"
    arguments = ["labels", "export", str(file), "--camera", "rgb", "--format", "coco", "--pictures"]
    assert main([*arguments, "--data", str(tmp_path / "data"), "--out", str(out)]) == 0
    picture = cv2.imread(str(out / f"{picture_name('rgb', 19_000)}.png"))
    assert picture is not None and picture[20, 30].tolist() == [0, 0, 255]


FOUR = ("near_left", "near_right", "far_left", "far_right")


@pytest.fixture
def four(tmp_path: Path, four_recording: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path / "labels", four_recording, FOUR)
    yield bench
    bench.close()


def labelled_in(bench: Bench, t_us: int) -> set[str]:
    return {name for name, work in bench.work.works.items() if t_us in work.labels}


def test_labels_in_two_cameras_propose_the_ball_in_the_others_and_one_key_accepts_it_there(four: Bench) -> None:
    for camera in FOUR[:2]:
        assert all(draft_at(four.work, BALL_US, name) is None for name in FOUR)
        four.editor.change_view({"camera": camera})
        four.click_truth(BALL_US)
    for name in FOUR[2:]:
        draft = draft_at(four.work, BALL_US, name)
        assert draft is not None and draft.detector == FROM_OTHERS and draft.covariance_px2 is not None
        assert np.hypot(*np.subtract((draft.x_px, draft.y_px), four.truth(BALL_US, name))) < 1.0
    four.press("accept_all")
    assert labelled_in(four, BALL_US) == set(FOUR) and four.work.t_us == BALL_US + 2000
    for name in FOUR:
        label = LabelStore.read(four.folder, Layer(four.recording.uuid, name, "anna")).at(BALL_US)
        assert label is not None and label.x_px is not None and label.y_px is not None
        assert np.hypot(*np.subtract((label.x_px, label.y_px), four.truth(BALL_US, name))) < 0.5
        made = label.provenance
        expected = (PositionSource.SNAPPED, "") if name in FOUR[:2] else (PositionSource.ACCEPTED, FROM_OTHERS)
        assert (made.source, made.detector) == expected
    four.editor.go_to(BALL_US)
    four.press("undo")
    assert labelled_in(four, BALL_US) == set(FOUR) - {four.work.view.camera}, "its click: the key changed others only"
    four.press("redo")
    assert labelled_in(four, BALL_US) == set(FOUR)
    four.editor.change_view({"camera": FOUR[2]})
    four.press("undo")
    assert labelled_in(four, BALL_US) == set(FOUR[:2]), "what one key accepted goes at once"
    four.press("redo", "right", "undo")
    four.editor.change_view({"camera": FOUR[3]})
    four.press("right")
    four.editor.change_view({"camera": FOUR[2]})
    four.press("undo")
    assert labelled_in(four, BALL_US) == set(FOUR) - {FOUR[2]}, "what was changed since stays"


@pytest.mark.gate
def test_what_follows_from_the_labels_is_shown_before_it_is_accepted_and_can_be_rejected(four: Bench) -> None:
    propose(four, BALL_US)
    four.wait(lambda: four.suggestions.share is None)
    blind = four.work.works["far_right"]
    assert blind.proposals is not None
    add = replace(four.work, works={**four.work.works, "far_right": replace(blind, proposals=None)})
    four.editor.labelling = add
    four.press("accept_all")
    assert labelled_in(four, BALL_US) == set(FOUR[:3]) and four.work.t_us == BALL_US, "something new is proposed"
    four.editor.change_view({"camera": "far_right"})
    four.press("reject")
    assert draft_at(four.work, BALL_US) is None
    four.press("accept_all")
    assert labelled_in(four, BALL_US) == set(FOUR[:3]) and four.work.t_us == BALL_US + 2000


def test_all_other_cameras_rays_and_their_ball_with_its_ellipse_are_drawn(four: Bench) -> None:
    def drawn(key) -> tuple[int, list[PointMark]]:
        rays = [mark for mark in key.marks if isinstance(mark, LineMark)]
        return len(rays), [mark for mark in key.marks if isinstance(mark, PointMark)]

    counts = []
    for camera in FOUR[:3]:
        four.editor.change_view({"camera": camera})
        four.click_truth(BALL_US, off_px=0.0)
        four.editor.change_view({"camera": "near_left"})
        plan = four.look(BALL_US)
        assert [key.camera for key in plan.others] == list(FOUR[1:])
        counts.append((drawn(plan.main)[0], drawn(plan.others[2])[0]))
    assert counts == [(0, 1), (1, 1), (2, 1)]
    (point,) = drawn(plan.main)[1]
    assert (point.x_px, point.y_px) == pytest.approx(four.truth(BALL_US, "near_left"), abs=1.0)
    assert point.covariance_px2[0] > 0
    four.editor.change_view({"epipolar": False})
    assert drawn(four.look(BALL_US).main) == (0, [])


def test_the_residual_of_each_camera_tells_which_one_has_something_else(four: Bench) -> None:
    for camera in FOUR:
        four.editor.change_view({"camera": camera})
        four.click_truth(BALL_US)
    four.look(BALL_US)
    good = agreement_at(four.work, BALL_US)
    assert good is not None and set(good.off_px) == set(FOUR) and max(good.off_px.values()) < 0.6
    four.press(*["down_more"] * 12)
    bad = agreement_at(four.work, BALL_US)
    assert bad is not None and bad.left_out == {"far_right"} and 11 < bad.off_px["far_right"] < 13
    assert bad.residual_px < 0.6 and agreement_words(bad) == "3 of 4 cameras agree to"
    assert agreement_words(replace(bad, residual_px=8.41, off_px={})) == "cameras disagree by"
    four.suggestions.next_suspicious()
    four.wait(lambda: four.suggestions.reason)
    assert "the cameras disagree" in four.suggestions.reason


def test_a_label_that_only_a_proposal_of_the_other_camera_contradicts_comes_first_in_the_queue(bench: Bench) -> None:
    bench.click_truth(BALL_US)
    bench.press(*["down_more"] * 14)
    x, y = bench.truth(BALL_US, "right")
    one = Proposals(
        np.array([BALL_US]), np.array([x]), np.array([y]), np.array([9.0]), np.array([[0.01, 0.0, 0.01]]), 2000, "d"
    )
    add_proposals(bench.editor, {"right": one})
    agreement = agreement_at(bench.work, BALL_US)
    assert agreement is not None and agreement_words(agreement) == "cameras disagree by"
    bench.suggestions.next_suspicious()
    bench.wait(lambda: bench.suggestions.reason)
    assert bench.suggestions.reason == f"the cameras disagree by {agreement.residual_px:.1f} px"
    assert bench.work.t_us == BALL_US


def test_a_whole_flight_is_accepted_in_four_cameras_though_one_sees_a_person(four: Bench) -> None:
    propose(four, BALL_US)
    four.wait(lambda: four.suggestions.share is None)
    part = four.work.works["far_left"].proposals
    assert part is not None
    add_proposals(four.editor, {"far_left": replace(part, x_px=100.0 + 0.0 * part.x_px, y_px=90.0 + 0.0 * part.y_px)})
    four.look(BALL_US)
    four.suggestions.take_flight()
    four.wait(lambda: four.notes)
    four.wait()
    assert four.notes[-1].title == "Flight accepted" and "4 cameras" in four.notes[-1].text
    counts = {name: len(work.labels) for name, work in four.work.works.items()}
    assert counts.pop("far_left") < 3 and min(counts.values()) > 30, counts
    for name in counts:
        labels = four.work.works[name].labels
        errors = [np.hypot(*np.subtract((one.x_px, one.y_px), four.truth(t, name))) for t, one in labels.items()]
        assert np.nanpercentile(errors, 95) < 1.0
