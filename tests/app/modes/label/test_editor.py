"""A browser's labelling without a browser: everything that a key does, written to the disk and read again."""

import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.cli.main import main
from app.modes.label.by_hand import place_ball, set_numbers, set_state
from app.modes.label.contacts import ContactSearch
from app.modes.label.keys import ACTS
from app.modes.label.sightings import agreement_at
from app.modes.label.suggestions import LISTED
from app.pictures.palette import PaletteIndex
from core.events import Events, SensorSize
from core.recordings import RecordingWriter
from labels.formats.exchange import picture_name
from labels.model import LabelState, PositionSource
from labels.store import LabelStore, Layer, find_layers
from labels.store_registry import LabelStoreRegistry
from tests.app.modes.label.label_bench import BALL_US, DETECTOR, Bench


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
    place_ball(bench.editor, *EMPTY)
    bench.wait(lambda: bench.work.asking)
    assert "no circle fits here: drag to set the radius, or press X for no ball" in bench.work.asking.question
    assert not bench.work.here.labels and not bench.errors
    marks = bench.look().main.marks
    assert [(mark.x_px, mark.y_px, mark.r_px, mark.ink) for mark in marks] == [(*EMPTY, None, PaletteIndex.ASKS)]
    stored = LabelStore.read(bench.folder, Layer(bench.recording.uuid, "left", "anna"))
    assert stored.all() == () and stored.version == 0
    place_ball(bench.editor, *EMPTY, 6.5)
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
    place_ball(bench.editor, *EMPTY)
    bench.wait(lambda: bench.work.asking)
    bench.editor.do(ACTS[answer])
    bench.wait()
    label = bench.work.here.labels[BALL_US]
    assert (label.state, label.r_px) == (state, r_px) and bench.work.click is None


def test_a_click_without_a_circle_is_forgotten_by_escape_or_by_going_elsewhere(bench: Bench) -> None:
    bench.look(BALL_US)
    place_ball(bench.editor, *EMPTY)
    bench.wait(lambda: bench.work.asking)
    bench.press("escape")
    assert bench.work.asking is None
    place_ball(bench.editor, *EMPTY)
    bench.wait(lambda: bench.work.asking)
    bench.press("next")
    assert bench.work.asking is None and not bench.work.here.labels


def test_going_on_after_each_click_comes_back_to_one_without_a_circle(bench: Bench) -> None:
    bench.editor.change_view({"advance": True})
    bench.look(BALL_US)
    place_ball(bench.editor, *EMPTY)
    assert bench.work.t_us == BALL_US + 2000
    bench.wait(lambda: bench.work.asking)
    assert bench.work.t_us == BALL_US


def test_without_snapping_the_first_click_asks_too_and_later_ones_keep_the_radius(bench: Bench) -> None:
    bench.editor.change_view({"snap": False})
    bench.look(BALL_US)
    place_ball(bench.editor, 50.0, 60.0)
    bench.wait(lambda: bench.work.asking)
    assert bench.work.asking.question.startswith("how large is it?")
    place_ball(bench.editor, 50.0, 60.0, 7.0)
    place_ball(bench.editor, 52.0, 61.0)
    bench.wait()
    label = bench.work.here.labels[BALL_US]
    assert (label.x_px, label.y_px, label.r_px) == (52.0, 61.0, 7.0)


@pytest.mark.parametrize("r_px", [None, 3.5])
def test_numbers_that_are_typed_in_need_a_radius_above_0(bench: Bench, r_px: float | None) -> None:
    bench.look(BALL_US)
    set_numbers(bench.editor, 20.0, 30.0, r_px)
    bench.wait()
    assert (BALL_US in bench.work.here.labels) == (r_px is not None)
    if r_px is None:
        assert "needs a radius" in str(bench.errors[0])
    else:
        set_numbers(bench.editor, 21.0, 30.0, None)
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


def test_the_queue_leads_to_the_listed_moments_first_and_not_to_labelled_ones(bench: Bench) -> None:
    bench.listed_us = (BALL_US + 20_900, BALL_US + 10_001, BALL_US)  # the nearest times that can be labelled are meant
    bench.click_truth(BALL_US)
    for t_us in (BALL_US + 10_000, BALL_US + 20_000):
        bench.look(0)
        bench.suggestions.next_suspicious()
        bench.wait(lambda t_us=t_us: bench.work.t_us == t_us)
        assert bench.suggestions.reason == LISTED


def test_a_second_look_goes_to_a_layer_of_its_own(bench: Bench) -> None:
    for t_us in range(0, 600_000, 2000):  # one in twenty of 280: none at all is unthinkable
        bench.look(t_us)
        set_state(bench.editor, LabelState.OUT_OF_FRAME)
    bench.wait()
    bench.suggestions.repeat_annotation()
    bench.wait(lambda: bench.work.view.repeat or bench.notes)
    assert bench.work.view.repeat
    asked = bench.work.t_us
    assert bench.look().main.marks == ()
    set_state(bench.editor, LabelState.NO_BALL)
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
    place_ball(bench.editor, 30.25, 20.5, 4.0)
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
