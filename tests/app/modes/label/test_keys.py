"""The keys of Label, and those that come before the picture or the proposals that they judge."""

import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.modes.label import suggestions
from app.modes.label.editor import LabelEditor
from app.modes.label.keys import JUDGES, KEYS, HeldKeys, label_keys_html
from app.modes.label.labelling import DEFAULT_STEP_US, Labelling
from app.modes.label.mode import LabelMode
from app.panels.keys import KEYS as OTHER_KEYS
from app.panels.keys import keys_html
from app.server import App
from app.shared.library import Library
from app.shared.workspace import Workspace
from app.state.commands import Seek
from benchmarks.app.bare_browser import BareBrowser
from tests.waiting import PATIENCE_S, eventually


def test_no_key_is_taken_twice_moves_the_camera_or_chooses_a_mode() -> None:
    taken = [(key, modifier) for key, modifier, _, _ in KEYS]
    assert len(set(taken)) == len(taken)
    plain = {key for key, _ in taken}
    assert not plain & set("WASDQE") and not any(key.startswith("arrow") for key in plain) and "tab" not in plain
    assert not {key for key, modifier in taken if modifier is None} & set("MTO")


def test_what_waits_for_what_it_judges_is_the_act_of_a_key() -> None:
    assert JUDGES.keys() <= {name for _, _, name, _ in KEYS}


def test_every_key_is_listed_for_the_person() -> None:
    shown = label_keys_html()
    assert all(text in shown for _, _, name, text in KEYS if not name.endswith("_more"))
    for listed in (shown, keys_html()):
        assert "Shift 1 to 5" in listed and "Mode: Watch, Tune, Label, Train, Export" in listed
    assert {"N", "P", "Z"} <= {key for key, _, _ in OTHER_KEYS}  # the same hands in the other modes


BALL_US = 300_000


class Hand:
    """Presses keys as fast as they are sent, and sees what has become of them."""

    def __init__(self, lab: App) -> None:
        self._browser = BareBrowser(lab.port)
        session = self._browser.wait_session(lab, PATIENCE_S)
        session.send(Seek(BALL_US))
        self._browser.trigger("Mode: Label", PATIENCE_S)
        mode = session._modes["Label"]
        assert isinstance(mode, LabelMode)
        self.session, self.mode = session, mode
        eventually(lambda: mode._editor is not None, "the editor")
        session.later(lambda: mode._use_name("hand"))
        eventually(self._is_ready, "its name, the picture, the labels and the step of Label")

    @property
    def editor(self) -> LabelEditor:
        assert self.mode._editor is not None
        return self.mode._editor

    @property
    def work(self) -> Labelling:
        return self.editor.labelling

    def _is_ready(self) -> bool:
        work = self.work
        named = work.view.annotator == "hand" and work.on_screen and "right" in work.saved
        return named and work.step_us == DEFAULT_STEP_US  # of Label, once the session has taken it over

    def keys(self, *names: str) -> None:
        """By the names of their acts."""
        texts = {name: text for _, _, name, text in KEYS}
        for name in names:
            self._browser.trigger(f"Label: {texts[name]}", PATIENCE_S)

    def offers(self) -> tuple[bool, bool]:
        """Whether the buttons of undo and redo can be pressed."""
        panel = self.mode._panel
        return not panel._undo.disabled, not panel._redo.disabled

    def close(self) -> None:
        self._browser.close()


@pytest.fixture
def hand(tmp_path: Path, serve_recording: Path) -> Iterator[Hand]:
    workspace = Workspace(tmp_path)
    shutil.copy(serve_recording, workspace.recording_path("serve"))
    lab = App(workspace, Library(workspace), "serve", host="127.0.0.1", port=0)
    hand = Hand(lab)
    yield hand
    hand.close()
    lab.stop()


def test_segments_are_accepted_though_enter_comes_before_proposals_and_pictures(hand: Hand) -> None:
    hand.keys("propose", "accept_segment")
    eventually(lambda: len(hand.work.works["left"].labels) > 10, "labels of the left camera")
    hand.keys("camera", "previous", "previous", "accept_segment", "ten_back", "ten_back")
    eventually(lambda: len(hand.work.works["right"].labels) > 10, "labels of the right camera")
    labels = sorted(hand.work.works["right"].labels)
    there_us = labels[-1] + 2000 - 20 * 2000  # what was pressed after Enter was done after it
    eventually(lambda: hand.work.t_us == there_us, "all keys to be done", lambda: hand.work.t_us)


def test_undo_takes_back_a_segment_that_had_to_wait(hand: Hand) -> None:
    hand.keys("propose", "accept_segment", "undo")
    eventually(lambda: "left" in hand.work.saved and hand.work.saved["left"].can_redo, "undo")
    assert not hand.work.here.labels
    eventually(lambda: hand.offers() == (False, True), "only redo to be offered", hand.offers)
    hand.keys("redo")
    eventually(lambda: len(hand.work.here.labels) > 10, "labels")
    eventually(lambda: hand.offers() == (True, False), "only undo to be offered", hand.offers)


def test_the_buttons_of_undo_and_redo_are_grey_before_anything_is_labelled(hand: Hand) -> None:
    eventually(lambda: hand.offers() == (False, False), "neither to be offered", hand.offers)


def test_in_space_and_time_enter_waits_for_no_picture_and_accepts_nothing(hand: Hand) -> None:
    hand.mode._host.later(lambda: hand.editor.change_view({"in_space": True}))
    eventually(lambda: hand.mode.middle == "space", "the events in space and time")
    hand.keys("next", "accept_segment", "next")
    eventually(lambda: hand.work.t_us == BALL_US + 4000, "all keys to be done", lambda: hand.work.t_us)
    assert not hand.work.here.labels


def test_a_contact_waits_for_the_picture_that_it_is_judged_on(hand: Hand) -> None:
    acts = ("hit", "next", "hit", "next")
    hand.session.later(lambda: [hand.mode._act(name) for name in acts])  # no picture comes between them
    eventually(lambda: hand.work.t_us == BALL_US + 4000, "all keys to be done", lambda: hand.work.t_us)
    found = lambda: [(one.t_us, str(one.kind)) for one in hand.work.contacts]  # noqa: E731
    eventually(lambda: found() == [(BALL_US + 2000, "hit")], "set, and moved", found)


def test_escape_forgets_what_waits(hand: Hand, monkeypatch: pytest.MonkeyPatch) -> None:
    pressed, find = threading.Event(), suggestions.propose

    def find_later(*given, **named):
        assert pressed.wait(PATIENCE_S)
        return find(*given, **named)

    monkeypatch.setattr(suggestions, "propose", find_later)
    hand.keys("propose", "accept_segment", "escape", "next")
    eventually(lambda: hand.work.t_us == BALL_US + 2000, "all keys to have come", lambda: hand.work.t_us)
    pressed.set()
    shown = lambda: hand.work.here.proposals is not None and hand.work.on_screen  # noqa: E731
    eventually(lambda: shown() and not hand.editor.writer.waiting, "the proposals to be shown")
    assert hand.work.t_us == BALL_US + 2000 and not hand.work.here.labels


class Desktop:
    """Acts that are written down; "late" must wait until it is open."""

    def __init__(self) -> None:
        self.open, self.place, self.done = False, 0, []
        self.keys = HeldKeys(self.done.append, lambda name: name == "late" and not self.open, lambda: self.place)

    def press(self, *names: str) -> None:
        for name in names:
            self.keys.press(name)


def test_acts_behind_one_that_waits_keep_their_order() -> None:
    desktop = Desktop()
    desktop.press("first", "late", "late", "second", "late")
    assert desktop.done == ["first"] and not desktop.keys.ready
    desktop.open = True
    assert desktop.keys.ready
    desktop.keys.go_on()
    assert desktop.done == ["first", "late", "second", "late"] and not len(desktop.keys)


def test_going_elsewhere_forgets_what_waits() -> None:
    desktop = Desktop()
    desktop.press("late", "second")
    desktop.open, desktop.place = True, 1
    assert desktop.keys.ready
    desktop.keys.go_on()
    desktop.press("third")
    assert desktop.done == ["third"]


def test_a_key_counts_at_the_time_that_was_asked_for_before_it(hand: Hand) -> None:
    session, mode = hand.session, hand.mode
    session.page._hear({"type": "bar", "do": "seek", "value": 100_000})
    session.later(lambda: mode._act("no_ball"))
    session.later(lambda: mode._act("out_of_frame"))
    session.page._hear({"type": "bar", "do": "seek", "value": 400_000})
    session.later(lambda: mode._act("no_ball"))
    eventually(lambda: len(hand.work.here.labels) == 3, "the labels", lambda: sorted(hand.work.here.labels))
    assert sorted(hand.work.here.labels) == [100_000, 102_000, 400_000]
    eventually(lambda: hand.work.t_us == 402_000, "the cursor to go on", lambda: hand.work.t_us)
