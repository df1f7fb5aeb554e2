"""Label, in a real browser. The screenshots are kept under test-artifacts/."""

import math
import re
import threading
from collections.abc import Callable, Iterator
from dataclasses import fields

import pytest

from app.modes.label.annotator import remember_annotator
from app.modes.label.by_hand import place_ball, set_state
from app.modes.label.labelling import LabelView
from app.modes.label.plan import plan_at
from app.pictures.palette import PaletteIndex, palette
from app.state.commands import Seek, SetRendering
from app.views.image_view import FOV_RAD, UNIT
from labels.conflicts import how_settled
from labels.contacts import contacts_of_truth
from labels.model import LabelState, PositionSource
from labels.store import LabelStore, Layer
from tests.app.browser.window import Window, choose_in, count_like
from tests.waiting import PATIENCE_S, eventually

BALL_US = 300_000


class Labelling:
    """Label mode of one window, and where things are on its screen."""

    def __init__(self, window) -> None:
        self.window = window
        self.mode = window.session._modes["Label"]
        self.page = window.page
        self._sent = self._arrived = 0
        mark = window.session.client.gui.add_command(
            "Test: all before this has arrived", hotkey="home", modifier="shift"
        )

        @mark.on_trigger
        async def _(_) -> None:
            window.session.later(self._count)

        self._knocked = threading.Event()
        knock = window.session.client.gui.add_command("Test: the keys are there", hotkey="end", modifier="shift")

        @knock.on_trigger
        async def _(_) -> None:
            self._knocked.set()

    def _count(self) -> None:
        self._arrived += 1

    def wait_for_keys(self) -> None:
        """Until the page has the keys of the mode, and nothing else keeps them: what came before has arrived, too."""
        self._knocked.clear()

        def answers() -> bool:
            self.page.keyboard.press("Shift+End")
            self.window.wait_for_frame()
            return self._knocked.is_set()

        eventually(answers, "the page to hear keys")

    @property
    def work(self):
        return self.mode._editor.labelling

    def settle(self, t_us: int | None = None) -> None:
        """Until everything is saved, and what is shown is what was asked for last."""
        saved = threading.Event()
        self.arrive()
        later = lambda _: self.window.session.later(saved.set)  # noqa: E731 - behind the answers to all earlier acts
        self.mode._editor.writer.look(self.work.layer, later, later)
        eventually(saved.is_set, "the writer")
        eventually(lambda: t_us is None or self.work.t_us == t_us, f"the cursor to reach {t_us}")
        eventually(self._shows_what_it_should, "the picture of the cursor")

    def arrive(self) -> None:
        """Until what the hand did so far has come from the browser to the app's loop."""
        self._sent += 1
        self.page.keyboard.press("Shift+Home")
        eventually(lambda: self._arrived == self._sent, "the keys to arrive")

    def _shows_what_it_should(self) -> bool:
        mode, seen, answers = self.mode, threading.Event(), []

        def compare() -> None:
            plan = plan_at(mode._scene(mode._editor, self.window.state), self.work.t_us, mode._pictures._centre)
            shown = mode._pictures.shown
            answers.append(shown is not None and shown.plan == plan and self.work.on_screen)
            seen.set()

        self.window.session.later(compare)
        assert seen.wait(PATIENCE_S)
        return answers[0] and not mode._pictures.busy

    def screen(self, x_px: float, y_px: float) -> tuple[float, float]:
        """CSS pixels of a sensor point in the large picture."""
        main = self.mode._pictures.shown.main
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
        """Place a label, and wait until it is there."""
        before = self.label(self.work.t_us)
        self.page.mouse.move(x - 8, y - 6)
        self.page.mouse.move(x, y, steps=3)
        self.page.mouse.click(x, y, delay=60)
        eventually(lambda: self.label(self.work.t_us) != before, "the click to arrive")

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """From the centre to the rim."""
        self.page.mouse.move(*start)
        self.page.mouse.down()
        self.page.mouse.move(*end, steps=8)
        self.page.wait_for_timeout(300)
        self.page.mouse.up()

    def keys(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)
            self.page.wait_for_timeout(120)

    def truth(self, t_us: int):
        truth = self.work.source.stream.truth.at(t_us)
        return truth.u_px, truth.v_px

    def overview(self, x_px: float, y_px: float) -> tuple[float, float]:
        """Sheet point of a sensor point in the small whole picture."""
        whole = self.mode._pictures.shown.overview
        return (
            whole.x + (x_px + 0.5) / whole.region.width * whole.width,
            whole.y + (y_px + 0.5) / whole.region.height * whole.height,
        )

    @property
    def zoom(self) -> float:
        """CSS pixels per sensor pixel."""
        return self.screen(1.0, 0.0)[0] - self.screen(0.0, 0.0)[0]

    def check_clicks(self, zooms: str) -> None:
        """Clicks at whole CSS pixels are stored where those are in the picture, at the middle of the CSS pixel."""
        x, y = (float(v[0]) for v in self.truth(self.work.t_us))
        self.window.session.later(
            lambda: self.mode._do(lambda editor: place_ball(editor, x, y, 9.5))
        )  # clicks keep this radius
        eventually(lambda: self.label(self.work.t_us), "the first label")
        view = {"snap": False, "follow": False}
        self.window.session.later(lambda: self.mode._do(lambda editor: editor.change_view(view)))
        for key in zooms:
            self.keys(key)
            self.settle()
            main = self.mode._pictures.shown.main
            for across, down in ((0.2, 0.3), (0.71, 0.64)):
                x, y = map(round, self.on_sheet(main.x + across * main.width, main.y + down * main.height))
                zero, zoom = self.screen(0.0, 0.0), self.zoom
                self.click(x, y)
                self.settle()
                label = self.label(self.work.t_us)
                aimed = ((x + 0.5 - zero[0]) / zoom, (y + 0.5 - zero[1]) / zoom)
                assert (label.x_px, label.y_px) == pytest.approx(aimed, abs=0.01), f"key {key}, {zoom} CSS px a pixel"

    def label(self, t_us: int):
        return self.work.here.labels.get(t_us)


@pytest.fixture(scope="module")
def first_labelling(open_window, lab) -> Iterator[Labelling]:
    """One window for all: opening it takes longer than most of what is tried in it."""
    with open_window(lab) as window:
        yield begin(window, "first")


@pytest.fixture
def labelling(first_labelling, request) -> Labelling:
    """The one window in Label, as it opens, at the ball and in a layer of the test's own."""
    found = first_labelling
    if found.window.state.mode != "Label":
        found.window.press("Label")
        eventually(lambda: found.mode._pictures.shown is not None, "the first picture")
    view = LabelView(camera="left", annotator=found.work.view.annotator)
    changes = {field.name: getattr(view, field.name) for field in fields(view)}
    found.window.session.later(lambda: found.mode._do(lambda editor: editor.change_view(changes)))
    found.window.session.send(SetRendering("polarity"))
    name = name_of(request)
    found.window.session.later(lambda: found.mode._use_name(name))
    eventually(lambda: found.work.view.annotator == name and "left" in found.work.saved, "the layer")
    found.window.seek(BALL_US)
    found.window.page.mouse.click(*found.on_sheet(1200, -10))  # keys do nothing while a field has the cursor
    found.settle(BALL_US)
    eventually(lambda: found.mode._suggestions.share is None, "no detector runs: I would cancel it")
    return found


def name_of(request: pytest.FixtureRequest) -> str:
    """An annotator for each test, and for each attempt of it, so that each has a layer of its own."""
    attempt = getattr(request.node, "execution_count", 1)
    return request.node.name[5:30].strip("_") + (f"-{attempt}" if attempt > 1 else "")


def begin(window: Window, name: str) -> Labelling:
    """Label mode at the ball, in a layer of the annotator's own."""
    window.seek(BALL_US)
    window.press("Label")
    found = Labelling(window)
    eventually(lambda: found.mode._pictures.shown is not None, "the first picture")
    window.wait_until_camera_stands()  # the sheet has another shape: the camera is moved
    window.fill(window.field("Annotator"), name)
    eventually(
        lambda: found.mode._sign_in.named and found.work.view.annotator == name and "left" in found.work.saved,
        "the layer",
    )
    window.page.mouse.click(*found.on_sheet(1200, -10))  # keys do nothing while a field has the cursor
    found.settle(BALL_US)
    return found


@pytest.mark.gate
def test_a_click_makes_a_label_that_is_on_the_disk(labelling, workspace) -> None:
    work = labelling.work
    truth = work.source.stream.truth.at(BALL_US)
    x, y = float(truth.u_px[0]), float(truth.v_px[0])
    labelling.click(*labelling.screen(x, y))
    labelling.settle()
    labelling.window.screenshot("label")
    labelling.keys("8")
    labelling.settle()
    labelling.window.screenshot("label-zoom")
    label = labelling.label(BALL_US)
    assert label.provenance.source is PositionSource.SNAPPED and label.state is LabelState.VISIBLE
    assert math.dist((label.x_px, label.y_px), (x, y)) < 0.8
    layer = Layer(work.recording.uuid, "left", work.view.annotator)
    assert LabelStore.read(workspace.labels, layer).at(BALL_US) == label


@pytest.mark.gate
def test_keys_do_everything_and_all_of_it_can_be_undone(labelling) -> None:
    x, y = (float(v[0]) for v in labelling.truth(BALL_US))
    labelling.click(*labelling.screen(x, y))
    labelling.settle()
    first = labelling.label(BALL_US)
    labelling.keys("h", "h", "b", "Shift+G", "Shift+PageUp")
    labelling.settle()
    label = labelling.label(BALL_US)
    assert (label.x_px, label.y_px) == pytest.approx((first.x_px - 0.5, first.y_px + 0.25))
    assert label.r_px == pytest.approx(first.r_px + 0.25) and label.provenance.source is PositionSource.BY_HAND
    labelling.keys("n", "c", "Shift+V", "n", "x")
    labelling.settle(BALL_US + 6000)
    assert labelling.label(BALL_US + 2000).state is LabelState.PARTLY_OCCLUDED
    assert labelling.label(BALL_US + 4000).state is LabelState.NO_BALL
    labelling.keys(*"z" * 8)
    labelling.settle(BALL_US)
    assert labelling.label(BALL_US) == first and not labelling.label(BALL_US + 4000)
    labelling.keys(*["Shift+Z"] * 5)
    labelling.settle(BALL_US)
    assert labelling.label(BALL_US) == label
    labelling.keys("Delete", "u")
    labelling.settle(BALL_US + 2000)
    assert labelling.label(BALL_US) is None and len(labelling.work.here.labels) == 0
    labelling.keys("3", "PageDown", "PageUp", "P", "5", "Shift+F")
    labelling.settle(BALL_US)
    assert labelling.work.view.window_us == 10_000 and labelling.mode._pictures.shown.plan.main.rendering == "count"
    labelling.keys("End")
    labelling.settle(598_000)
    labelling.keys("Home")
    labelling.settle(0)


def test_a_drag_gives_centre_and_radius(labelling) -> None:
    labelling.keys("8")
    labelling.settle()
    x, y = (float(v[0]) for v in labelling.truth(BALL_US))
    labelling.page.mouse.click(*labelling.on_sheet(*labelling.overview(x, y)))
    labelling.settle()
    mode = labelling.mode
    assert mode._search._wanted is None, "where a person looks, no answer that comes late moves the picture"
    start, end = labelling.screen(x, y), labelling.screen(x + 9.5, y)
    labelling.page.mouse.move(*start)
    labelling.page.mouse.down()
    labelling.page.mouse.move(*end, steps=8)
    eventually(lambda: mode._pointer.ring, "the ring that is drawn")
    labelling.window.session.later(lambda: mode._search._found((100.0, 100.0)))  # nor under a hand that draws
    labelling.page.wait_for_timeout(300)
    labelling.window.screenshot("label-drag")
    labelling.page.mouse.up()
    eventually(lambda: labelling.label(BALL_US), "the drag to arrive")
    labelling.settle()
    label = labelling.label(BALL_US)
    pixel = 1 / labelling.zoom
    assert math.dist((label.x_px, label.y_px), (x, y)) < pixel and abs(label.r_px - 9.5) < 2 * pixel
    assert label.provenance.source is PositionSource.BY_HAND


def test_clicks_land_where_they_are_aimed_at_every_zoom(labelling) -> None:
    labelling.check_clicks(zooms="6789")


@pytest.mark.parametrize("dense_window", [1.25, 2], indirect=True)
def test_clicks_land_where_they_are_aimed_on_dense_screens(dense_window, request) -> None:
    begin(dense_window, name_of(request)).check_clicks(zooms="69")


@pytest.mark.gate
def test_proposals_are_accepted_by_key_and_by_segment(labelling) -> None:
    labelling.keys("i")
    eventually(lambda: len(labelling.work.here.proposals or ()) > 20, "proposals")
    labelling.keys("8")
    labelling.settle(BALL_US)
    labelling.window.screenshot("label-proposed")
    labelling.keys("Space")
    labelling.settle(BALL_US + 2000)
    accepted = labelling.label(BALL_US)
    assert accepted.provenance.source is PositionSource.ACCEPTED and accepted.provenance.detector.startswith("refined#")
    labelling.keys("r")
    labelling.settle()
    assert labelling.work.here.draft(BALL_US + 2000) is None
    labelling.keys("n")
    labelling.settle(BALL_US + 4000)
    labelling.keys("Enter")
    eventually(lambda: len(labelling.work.here.labels) > 10, "the segment")
    labelling.settle()
    labels = sorted(labelling.work.here.labels)
    assert BALL_US + 2000 not in labels
    truth = labelling.work.source.stream.truth.at(labels)
    errors = [
        math.hypot(
            labelling.work.here.labels[t].x_px - truth.u_px[k], labelling.work.here.labels[t].y_px - truth.v_px[k]
        )
        for k, t in enumerate(labels)
    ]
    assert sorted(errors)[len(errors) // 2] < 0.5
    labelling.keys("0")
    labelling.window.seek(BALL_US)  # the segment may have ended just before the hit, round which nothing is accepted
    labelling.settle(BALL_US)
    labelling.keys("Enter")
    eventually(
        lambda: len(labelling.work.here.labels) > 10 and labelling.work.view.camera == "right",
        "the other camera's segment",
    )
    labelling.keys("p", "p", "p")
    labelling.settle()
    labelling.window.screenshot("label-stereo")
    labelling.keys("z", "0", "z")
    labelling.settle()
    assert len(labelling.work.works["right"].labels) == 0


def test_tune_scores_a_config_against_the_labels(labelling) -> None:
    window = labelling.window
    labelling.keys("i")
    eventually(lambda: len(labelling.work.here.proposals or ()) > 60, "proposals")
    labelling.settle(BALL_US)
    labelling.keys("Enter")
    eventually(lambda: len(labelling.work.here.labels) > 20, "the segment")
    window.press("Score the detector")  # Tune's own button takes the truth of this simulated camera
    window.page.get_by_text("labels by").first.wait_for()
    window.wait_for_frame()
    window.screenshot("tune-score-labels")
    window.page.get_by_role("button", name="Back to Label", exact=True).click()
    eventually(lambda: window.state.mode == "Label", "what was labelled, with the table gone")


def test_a_click_where_no_circle_fits_asks_and_stores_nothing_until_a_radius_is_given(labelling) -> None:
    x, y = 40.0, 24.0  # nothing happens there
    saved_at = labelling.mode._editor.writer.saved_at
    labelling.page.mouse.click(*labelling.screen(x, y), delay=60)
    eventually(lambda: labelling.work.asking, "the question")
    labelling.settle()
    labelling.window.screenshot("label-click-without-a-circle")
    asked = labelling.page.get_by_text("no circle fits here: drag to set the radius, or press X for no ball")
    eventually(lambda: asked.count() == 2, "it in the panel, and where the eyes are: in the line under the picture")
    assert not labelling.work.here.labels and labelling.mode._editor.writer.saved_at == saved_at
    labelling.drag(labelling.screen(x, y), labelling.screen(x + 12.0, y))
    eventually(lambda: labelling.label(BALL_US), "the drag to arrive")
    assert abs(labelling.label(BALL_US).r_px - 12.0) < 2 / labelling.zoom and labelling.work.asking is None
    labelling.keys("n")
    labelling.settle(BALL_US + 2000)
    labelling.page.mouse.click(*labelling.screen(x, y), delay=60)
    eventually(lambda: labelling.work.asking, "the question")
    labelling.keys("x")
    eventually(lambda: labelling.label(BALL_US + 2000), "the key to arrive")
    assert labelling.label(BALL_US + 2000).state is LabelState.NO_BALL


def test_contacts_are_proposed_accepted_set_and_moved_by_keys_and_reached_from_a_list(labelling, workspace) -> None:
    page, work = labelling.page, labelling.work
    contacts = lambda: [(one.t_us, str(one.kind)) for one in labelling.work.contacts]  # noqa: E731
    heading = page.get_by_text("Bounces, hits and net")
    assert page.get_by_role("button", name="Remove", exact=True).bounding_box()["y"] < 700, "in sight at 1280 x 720"
    labelling.keys("Home", "i")
    counted = page.get_by_text(re.compile(r"\d+ labelled, \d+ proposed|propos(ing|als):"))
    bounce = page.get_by_text("0 labelled, 1 proposed")

    def stands() -> tuple[object, ...]:
        now, job = labelling.work, labelling.mode._suggestions
        return counted.all_inner_texts(), now.t_us, len(now.here.proposals or ()), job.share, len(labelling.mode._keys)

    eventually(bounce.is_visible, "the bounce of the serve", stands)
    page.get_by_text("proposed by refined").wait_for()
    heading.scroll_into_view_if_needed()
    labelling.window.screenshot("label-contacts-proposed")
    labelling.keys("Shift+L")
    bounce_us = labelling.work.proposed_contacts[0].t_us
    labelling.settle(bounce_us)
    labelling.keys("Shift+Enter")
    page.get_by_text("1 labelled, 0 proposed").wait_for()
    assert contacts() == [(bounce_us, "bounce")]
    truth_us = contacts_of_truth(work.recording.ball)[0].t_us
    assert abs(bounce_us - truth_us) < 1_000
    labelling.window.seek(BALL_US)
    page.mouse.click(*labelling.on_sheet(1200, -10))
    labelling.settle(BALL_US)
    labelling.keys("Shift+O", "n", "Shift+O")
    labelling.settle(BALL_US + 2_000)
    assert contacts() == [(BALL_US + 2_000, "hit"), (bounce_us, "bounce")], "set, and moved by the same key"
    page.locator(f"[data-rallyscope-seek='{bounce_us}']").click()
    labelling.settle(bounce_us)
    labelling.window.screenshot("label-contacts")
    tip = page.locator("#rallyscope-tip")
    box, end_us = page.locator("#rallyscope-line").bounding_box(), labelling.window.state.playhead.duration_us
    page.mouse.move(box["x"] + box["width"] * (BALL_US + 2_000) / end_us, box["y"] + 20)
    eventually(lambda: "labelled hit ±0.58 ms" in tip.inner_text(), "the mark in the time bar to say what it is")
    labelling.keys("Shift+Delete")
    page.get_by_text("1 labelled, 1 proposed").wait_for()
    labelling.keys("z")
    page.get_by_text("2 labelled, 0 proposed").wait_for()
    layer = Layer(work.recording.uuid, "left", work.view.annotator)
    with LabelStore.read(workspace.labels, layer) as store:
        made = {str(one.kind): one.provenance for one in store.contacts()}
    assert {kind: (str(one.source), one.annotator) for kind, one in made.items()} == {
        "bounce": ("accepted", work.view.annotator),
        "hit": ("by_hand", work.view.annotator),
    }


def test_what_happens_meanwhile_does_not_write_into_the_name_that_is_typed(window, workspace) -> None:
    name, field = "last-one", window.field("Annotator")
    remember_annotator(workspace.labels, name)
    window.press("Label")
    field.wait_for()
    assert field.input_value() == name, "the name that is offered is there as soon as its field"
    field.fill("")
    mode = window.session._modes["Label"]
    eventually(lambda: mode._editor is not None and mode._editor.labelling.on_screen, "the picture")
    there_us = mode._editor.labelling.t_us + 100_000
    window.session.send(Seek(there_us))
    eventually(lambda: mode._display.t_us == there_us, "the panel to follow")
    assert field.input_value() == "" and mode._panel._annotator.value == name, "a value counts when it is whole"
    window.fill(field, name)
    eventually(lambda: mode._sign_in.named, "the name that was offered, to count as given once it is typed")


def test_the_first_label_of_a_browser_asks_who_labels(window, workspace) -> None:
    t_us = 450_000  # the name that is offered may have labels elsewhere
    window.seek(t_us)
    window.press("Label")
    mode = window.session._modes["Label"]
    eventually(lambda: mode._editor is not None and mode._editor.labelling.on_screen, "the picture")
    asked, labelling = window.page.get_by_text("Who labels?"), Labelling(window)
    labelling.wait_for_keys()
    window.page.keyboard.press("x")
    asked.wait_for()
    field = window.field("Your name")
    selected = "box => box.value.length > 0 && box.selectionStart === 0 && box.selectionEnd === box.value.length"
    eventually(lambda: field.evaluate(selected), "the name that is offered to be replaced by what is typed")
    window.wait_for_frame()
    window.screenshot("label-who")
    assert t_us not in mode._editor.labelling.here.labels
    window.fill(field, "x" * 41)
    window.press("Label under this name")
    window.page.get_by_text("too long a name").wait_for()
    window.fill(field, "")
    field.fill("Carla K")
    field.press("Enter")  # at once: what was typed last is taken all the same
    eventually(lambda: t_us in mode._editor.labelling.here.labels, "the label that was asked for first")
    assert mode._editor.labelling.here.labels[t_us].provenance.annotator == "carla-k"
    assert (workspace.labels / "last-annotator.txt").read_text() == "carla-k"
    asked.wait_for(state="detached")
    labelling.wait_for_keys()
    labelling.keys("n", "x")
    eventually(lambda: len(mode._editor.labelling.here.labels) >= 2, "the second label, without a question")
    assert asked.count() == 0


def test_two_browsers_of_one_annotator_see_each_other_and_undo_only_their_own(labelling, other_window, request) -> None:
    other = begin(other_window, name_of(request))

    def wait_for_both(one: Labelling, two: Labelling, there: Callable[[Labelling], object], what: str) -> None:
        eventually(lambda: there(one), f"{what} in its own browser")
        eventually(lambda: there(two), f"{what} in the other browser")

    labelling.keys("n", "x")
    wait_for_both(labelling, other, lambda one: one.label(BALL_US + 2000), "the first browser's label")
    other.keys("x")
    wait_for_both(other, labelling, lambda one: one.label(BALL_US), "the second browser's label")
    labelling.keys("z")
    wait_for_both(labelling, other, lambda one: not one.label(BALL_US + 2000), "undo of the first browser's own label")
    assert labelling.label(BALL_US), "the other's label, though made later, stays"
    labelling.keys("z")
    labelling.settle()
    assert labelling.label(BALL_US)
    labelling.keys("p", "Shift+X")
    eventually(lambda: other.label(BALL_US).state is LabelState.OUT_OF_FRAME, "the change in the other browser")
    other.keys("z")
    other.page.get_by_text("Somebody else has changed the label").wait_for()
    assert other.label(BALL_US).state is LabelState.OUT_OF_FRAME
    other.window.screenshot("label-undo-left-as-it-is")


def test_two_who_disagree_are_shown_side_by_side_and_keys_settle_it(
    labelling, other_window, request, workspace
) -> None:
    other = begin(other_window, name_of(request) + "-b")
    mode, times = labelling.mode, (BALL_US, BALL_US + 2_000, BALL_US + 4_000)
    x, y = (float(v[0]) for v in labelling.truth(BALL_US))
    for one, off_px in ((labelling, 0.0), (other, 5.0)):
        for t_us in times:
            place = (x + off_px, y, 9.0 + off_px)
            one.window.session.later(lambda t=t_us, one=one: one.mode._do(lambda editor: editor.go_to(t)))
            eventually(lambda t=t_us, one=one: one.work.t_us == t and one.work.on_screen, "the picture")
            one.window.session.later(
                lambda one=one, place=place: one.mode._do(lambda editor: place_ball(editor, *place))
            )
            eventually(lambda t=t_us, one=one: one.label(t), "the label")
    other.window.session.later(lambda: other.mode._do(lambda editor: set_state(editor, LabelState.NO_BALL)))
    eventually(lambda: other.label(times[2]).state is LabelState.NO_BALL, "the other's last word")
    names = labelling.work.view.annotator, other.work.view.annotator
    eventually(lambda: names[1] in mode._comparer.offered, "the other annotator in the list")
    page = labelling.page
    page.get_by_text("Compare and merge").click()
    choose_in(page.get_by_label("Compare with").first, names[1])
    page.get_by_text("0 of 3 settled").wait_for()
    page.mouse.click(*labelling.on_sheet(1200, -10))
    labelling.keys("8", "Shift+N")  # from the last: round to the first
    labelling.settle(times[0])
    page.get_by_text("5.00 px apart").wait_for()
    page.get_by_text("5.00 px apart").scroll_into_view_if_needed()
    rgb = palette("orange / blue")
    labelling.window.wait_for_pixels(
        "label-conflict",
        lambda pixels: all(count_like(pixels, rgb[ink], 25) > 150 for ink in (PaletteIndex.MINE, PaletteIndex.THEIRS)),
    )
    labelling.keys("l")
    page.get_by_text("1 of 3 settled").wait_for()
    labelling.settle(times[1])
    labelling.keys("Shift+J")
    page.get_by_text("2 of 3 settled").wait_for()
    labelling.settle(times[2])
    labelling.keys("j")
    page.get_by_text("3 of 3 settled").wait_for()
    labelling.window.screenshot("label-settled")
    labelling.keys("z")
    page.get_by_text("2 of 3 settled").wait_for()
    labelling.keys("Shift+N")
    labelling.settle(times[2])
    labelling.keys("j")
    page.get_by_text("3 of 3 settled").wait_for()
    stores = [LabelStore.read(workspace.labels, Layer(labelling.work.recording.uuid, "left", name)) for name in names]
    kept, theirs = ([store.at(t_us) for t_us in times] for store in stores)
    assert [label.x_px for label in kept] == pytest.approx([x + 5.0, x + 2.5, x])
    assert {(label.provenance.source, label.provenance.annotator) for label in kept} == {
        (PositionSource.SETTLED, names[0])
    }
    assert [how_settled(one, names[1], two) for one, two in zip(kept, theirs, strict=True)] == [
        "theirs",
        "mean",
        "mine",
    ]
    assert {label.provenance.annotator for label in theirs} == {names[1]}, "the other's labels are the other's"
