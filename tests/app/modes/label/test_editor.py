"""A browser's labelling without a browser: everything that a key does, written to the disk and read again."""

import queue
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.cli.main import main
from app.modes.label.assistant import Assistant
from app.modes.label.commands.by_name import COMMANDS
from app.modes.label.commands.cursor import ChangeView, GoTo, StepBy
from app.modes.label.commands.hand import PlaceBall, SetState
from app.modes.label.editor import LabelCallbacks, LabelEditor
from app.modes.label.labelling import Labelling, begin_labelling
from app.modes.label.plan import CameraWork, LabelScene, PicturePlan, agreement_at, centre_at, plan_at
from app.modes.label.view import LabelView
from app.modes.services import LABEL_TOOL
from core.detection import DetectorConfig
from core.events import Events, SensorSize
from core.recordings import RecordingWriter, open_recording
from labels.formats.exchange import picture_name
from labels.model import LabelState, PositionSource
from labels.store import LabelStore, Layer, find_layers
from labels.store_registry import LabelStoreRegistry

BALL_US = 300_000


class Bench:
    """An editor with a loop of its own."""

    def __init__(self, folder: Path, recording: Path, cameras: tuple[str, ...] = ("left", "right")) -> None:
        from concurrent.futures import ThreadPoolExecutor

        self.folder, self.errors, self.notes = folder, [], []
        self._inbox: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self.recording = open_recording(recording)
        callbacks = LabelCallbacks(self._inbox.put, self.errors.append, self.notes.append, lambda t_us: None)
        stores = LabelStoreRegistry(folder, tool=LABEL_TOOL)
        view = LabelView(camera="left", annotator="anna")
        self.editor = LabelEditor(stores, begin_labelling(self.recording, view, 2000, time.monotonic()), callbacks)
        self.pool = ThreadPoolExecutor(1)
        self.assistant = Assistant(self.editor, self.pool)
        self.wait(lambda: set(cameras) <= set(self.work.saved))

    @property
    def work(self) -> Labelling:
        return self.editor.labelling

    def close(self) -> None:
        self.assistant.close()
        self.editor.close()
        self.pool.shutdown()
        self.recording.close()

    def wait(self, condition: Callable[[], object] | None = None, timeout_s: float = 60.0) -> None:
        """Run the loop until the condition holds, or until nothing is waiting."""
        deadline = time.monotonic() + timeout_s
        while True:
            while not self._inbox.empty():
                self._inbox.get()()
            if (condition or (lambda: not self.editor.writer.waiting))() and self._inbox.empty():
                return
            assert time.monotonic() < deadline
            time.sleep(0.005)

    def scene(self) -> LabelScene:
        work = self.work
        there = CameraWork() if work.there is None else work.there
        return LabelScene(work.source, work.partner, work.view, "polarity", "orange / blue", work.here, there)

    def look(self, t_us: int | None = None) -> PicturePlan:
        """As if the picture at the cursor had been shown."""
        if t_us is not None:
            self.editor.send(GoTo(t_us))
        scene = self.scene()
        plan = plan_at(scene, self.work.t_us, centre_at(scene, self.work.t_us, None))
        self.editor.show(plan)
        return plan

    def press(self, *names: str) -> None:
        for name in names:
            self.look()
            self.editor.send(COMMANDS[name])
        self.wait()

    def truth(self, t_us: int, camera: str = "left") -> tuple[float, float]:
        truth = self.recording.cameras[camera].truth
        assert truth is not None
        here = truth.at(t_us)
        return float(here.u_px[0]), float(here.v_px[0])

    def click_truth(self, t_us: int, off_px: float = 1.0) -> None:
        self.look(t_us)
        x, y = self.truth(t_us, self.work.view.camera)
        self.editor.send(PlaceBall(x + off_px, y))
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
    bench.editor.send(COMMANDS["accept"])
    bench.editor.send(COMMANDS["accept"])  # the cursor is further, the picture is not
    bench.wait()
    assert sorted(bench.work.here.labels) == [BALL_US]


def test_a_rejected_proposal_is_gone_and_the_time_stays_unchecked(bench: Bench) -> None:
    propose(bench, BALL_US)
    assert bench.work.here.draft(BALL_US) is not None
    bench.look(BALL_US)
    bench.press("reject")
    assert bench.work.here.draft(BALL_US) is None and not bench.work.here.labels


def test_proposals_of_both_cameras_come_together(bench: Bench) -> None:
    bench.editor.send(GoTo(BALL_US))
    bench.assistant.toggle_propose(DetectorConfig())
    bench.wait(lambda: any(work.proposals is not None for work in bench.work.works.values()))
    assert all(work.proposals is not None for work in bench.work.works.values())


def test_a_segment_without_proposals_says_so(bench: Bench) -> None:
    bench.look(BALL_US)
    bench.editor.send(COMMANDS["accept_segment"])
    assert [note.title for note in bench.notes] == ["No proposals here"]


def test_a_segment_is_accepted_as_one_step(bench: Bench) -> None:
    propose(bench, BALL_US)
    bench.look(BALL_US)
    bench.editor.send(COMMANDS["accept_segment"])
    bench.wait()
    labels = bench.work.here.labels
    assert len(labels) > 20 and {label.provenance.source for label in labels.values()} == {PositionSource.ACCEPTED}
    truth = {t_us: bench.truth(t_us) for t_us in labels}
    assert max(abs((label.x_px or 0) - truth[t][0]) for t, label in labels.items()) < 2.0
    bench.press("undo")
    assert not bench.work.here.labels


def test_labels_between_keyframes_are_interpolated_in_space_where_both_cameras_are_labelled(bench: Bench) -> None:
    times = range(BALL_US, BALL_US + 81_000, 10_000)
    for camera in ("right", "left"):
        bench.editor.send(ChangeView({"camera": camera}))
        for t_us in times:
            bench.click_truth(t_us)
    bench.editor.send(GoTo(BALL_US + 6_000))
    bench.editor.send(COMMANDS["interpolate"])
    bench.wait()
    labels = bench.work.here.labels
    between = {t: label for t, label in labels.items() if label.provenance.source is PositionSource.INTERPOLATED}
    assert len(between) == 4 * 8 and {label.provenance.detector for label in between.values()} == {"flight"}
    errors = [abs((label.x_px or 0) - bench.truth(t)[0]) for t, label in between.items()]
    assert max(errors) < 1.0


def test_the_cameras_agree_on_the_same_ball_and_not_on_another(bench: Bench) -> None:
    for camera in ("right", "left"):
        bench.editor.send(ChangeView({"camera": camera}))
        bench.click_truth(BALL_US)
    good = agreement_at(bench.scene(), BALL_US)
    assert good is not None and good.residual_px < 0.6
    bench.press(*["down_more"] * 8)
    bad = agreement_at(bench.scene(), BALL_US)
    assert bad is not None and bad.residual_px > 2.5


def test_the_queue_leads_to_the_label_that_is_wrong(bench: Bench) -> None:
    for t_us in range(BALL_US, BALL_US + 30_000, 2000):
        bench.click_truth(t_us)
    wrong = BALL_US + 14_000
    bench.look(wrong)
    bench.press(*["down_more"] * 9)
    bench.look(BALL_US)
    bench.assistant.next_suspicious()
    bench.wait(lambda: bench.assistant.reason)
    assert bench.work.t_us == wrong and "neighbours" in bench.assistant.reason


def test_a_second_look_goes_to_a_layer_of_its_own(bench: Bench) -> None:
    for t_us in range(0, 600_000, 2000):  # one in twenty of 280: none at all is unthinkable
        bench.look(t_us)
        bench.editor.send(SetState(LabelState.OUT_OF_FRAME))
    bench.wait()
    bench.assistant.second_look()
    bench.wait(lambda: bench.work.view.blind or bench.notes)
    assert bench.work.view.blind
    asked = bench.work.t_us
    assert bench.look().main.marks == ()
    bench.editor.send(SetState(LabelState.NO_BALL))
    bench.wait(lambda: not bench.work.view.blind)
    second = LabelStore.read(bench.folder, Layer(bench.recording.uuid, "left", "anna", blind=True))
    label = second.at(asked)
    assert label is not None and label.state is LabelState.NO_BALL
    assert bench.work.here.labels[asked].state is LabelState.OUT_OF_FRAME


def propose(bench: Bench, t_us: int) -> None:
    """Until the detector has been through 100 ms from there."""
    bench.editor.send(GoTo(t_us))
    bench.assistant.toggle_propose(DetectorConfig())
    bench.wait(
        lambda: (bench.assistant.share is not None and bench.assistant.share > 0.3) or bench.assistant.share is None
    )
    if bench.assistant.share is not None:
        bench.assistant.toggle_propose(DetectorConfig())


def test_frames_are_labelled_at_their_own_times_and_exposures_and_exported(tmp_path: Path) -> None:
    file = tmp_path / "both.h5"
    sensor = SensorSize(64, 48)
    with RecordingWriter(file, {"left": sensor, "rgb": sensor}, seed=1) as writer:
        writer.append("left", Events.from_columns([0, 50_000], [1, 2], [3, 4], [True, False], sensor))
        images = np.full((3, 48, 64, 3), 90, np.uint8)
        images[1, 20, 30] = (255, 0, 0)
        writer.write_frames("rgb", np.array([9_000, 19_000, 29_000]), np.full(3, 4_000), images)
    bench = Bench(tmp_path / "data" / "labels", file, cameras=("left", "rgb"))
    bench.editor.send(ChangeView({"camera": "rgb"}))
    assert bench.work.partner is None
    bench.editor.send(StepBy(+1))
    bench.editor.send(StepBy(+1))
    assert bench.work.t_us == 19_000
    plan = bench.look()
    assert (plan.main.frame, plan.main.window_us) == (1, (17_000, 21_000))
    bench.editor.send(PlaceBall(30.25, 20.5))
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
