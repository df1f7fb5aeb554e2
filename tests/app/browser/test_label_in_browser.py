"""Label, in a real browser. The screenshots are kept under test-artifacts/."""

import math

import pytest

from app.plane import FOV_RAD, UNIT
from labels.model import Source, State
from labels.store import LabelStore, Layer

pytestmark = pytest.mark.browser
BALL_US = 300_000


class Labelling:
    """Label mode of one window, and where things are on its screen."""

    def __init__(self, window, wait_for) -> None:
        self.window, self._wait_for = window, wait_for
        self.mode = window.session._modes["Label"]
        self.page = window.page

    @property
    def work(self):
        return self.mode._work

    def settle(self, t_us: int | None = None) -> None:
        """Until everything is saved, and what is shown is what was asked for last."""
        work = self.work
        self._wait_for(lambda: t_us is None or work.t_us == t_us, f"the cursor to reach {t_us}")
        self._wait_for(lambda: not work.desk.waiting and not self.mode._pictures.busy, "the desk and the pictures")
        self.page.wait_for_timeout(100)
        self._wait_for(lambda: work.on_screen and not self.mode._pictures.busy, "the picture of the cursor")

    def screen(self, x_px: float, y_px: float) -> tuple[float, float]:
        """CSS pixels of a sensor point in the large picture."""
        main = self.mode._shown.main
        across = (x_px + 0.5 - main.region.x) / main.region.width
        down = (y_px + 0.5 - main.region.y) / main.region.height
        return self.on_sheet(main.x + across * main.width, main.y + down * main.height)

    def on_sheet(self, x: float, y: float) -> tuple[float, float]:
        """CSS pixels of a point of the sheet."""
        box = self.page.locator("canvas").first.bounding_box()
        camera = self.window.session.client.camera
        scale = box["height"] / (2 * abs(camera.position[2]) * math.tan(FOV_RAD / 2))
        return (
            box["x"] + box["width"] / 2 + (x * UNIT - camera.look_at[0]) * scale,
            box["y"] + box["height"] / 2 + (y * UNIT - camera.look_at[1]) * scale,
        )

    def click(self, x: float, y: float) -> None:
        self.page.mouse.move(x - 8, y - 6)
        self.page.mouse.move(x, y, steps=3)
        self.page.mouse.click(x, y, delay=60)

    def keys(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)
            self.page.wait_for_timeout(120)

    def label(self, t_us: int):
        return self.work.here.labels.get(t_us)


@pytest.fixture
def labelling(window, wait_for):
    window.seek(BALL_US)
    window.press("Label")
    found = Labelling(window, wait_for)
    wait_for(lambda: found.mode._shown is not None, "the first picture")
    found.page.wait_for_timeout(600)  # the sheet has another shape: the camera is moved
    found.settle(BALL_US)
    return found


def test_a_click_makes_a_label_that_is_on_the_disk(labelling, workspace) -> None:
    work = labelling.work
    truth = work.source.stream.truth.at(BALL_US)
    x, y = float(truth.u_px[0]), float(truth.v_px[0])
    labelling.click(*labelling.screen(x, y))
    labelling.settle()
    labelling.window.screenshot("label")
    labelling.page.keyboard.press("8")
    labelling.settle()
    labelling.window.screenshot("label-zoom")
    label = labelling.label(BALL_US)
    assert label.provenance.source is Source.SNAPPED and label.state is State.VISIBLE
    assert math.dist((label.x_px, label.y_px), (x, y)) < 0.8
    layer = Layer(work.recording.uuid, "left", "annotator")
    assert LabelStore.read(workspace.labels, layer).at(BALL_US) == label
