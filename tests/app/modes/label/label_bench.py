"""An editor of labels without a browser, with a loop of its own."""

import queue
import time
from collections.abc import Callable
from pathlib import Path

from app.modes.label.by_hand import place_ball
from app.modes.label.editor import LabelCallbacks, LabelEditor
from app.modes.label.keys import ACTS
from app.modes.label.labelling import Labelling, LabelView, begin_labelling
from app.modes.label.plan import LabelScene, PicturePlan, centre_at, plan_at
from app.modes.label.suggestions import LabelSuggestions
from app.modes.services import LABEL_TOOL
from core.detection import refined_config
from core.detection.saved import SavedDetector
from core.recordings import open_recording
from labels.store_registry import LabelStoreRegistry
from tests.waiting import eventually

BALL_US = 300_000
DETECTOR = SavedDetector("refined", refined_config())
FOUR = ("near_left", "near_right", "far_left", "far_right")


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
        self.listed_us: tuple[int, ...] = ()
        self.suggestions = LabelSuggestions(self.editor, self.pool, lambda uuid: self.listed_us)
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
        place_ball(self.editor, x + off_px, y)
        self.wait()


def propose(bench: Bench, t_us: int) -> None:
    """Until the detector has been through 100 ms from there."""
    bench.editor.go_to(t_us)
    bench.suggestions.toggle_propose(DETECTOR)
    bench.wait(lambda: bench.suggestions.share is None or bench.suggestions.share > 0.3)
    if bench.suggestions.share is not None:
        bench.suggestions.toggle_propose(DETECTOR)


def labelled_in(bench: Bench, t_us: int) -> set[str]:
    return {name for name, work in bench.work.works.items() if t_us in work.labels}
