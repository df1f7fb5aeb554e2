"""The guided tour of the app: its steps, and the card that shows them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Protocol

from app.state.client_state import MODES, ModeName
from app.web.pages import Json, Message

PICTURE: Final = "picture"
"""Anchor for the middle of the window."""
TIME_BAR: Final = "#rallyscope-bar"


@dataclass(frozen=True, slots=True)
class TourStep:
    """One card of the tour."""

    title: str
    text: str
    at: str
    """Element it explains: `PICTURE`, the #id of an element of ours, or the text on it."""


TOURS: Final[Mapping[ModeName, tuple[TourStep, ...]]] = {
    "Watch": (
        TourStep(
            "A rally, seen by two event cameras",
            "Two cameras that report only changes of brightness watch the ball. Their events give its position in "
            "space, and its flight is predicted: pale blue before the bounce, cyan after it, in a tube of two "
            "standard deviations. The racket goes where the prediction says. Drag to turn the view, wheel to come "
            "closer.",
            PICTURE,
        ),
        TourStep(
            "Time",
            "Play, step, or drag along the line. Slow motion goes down to 1/1000. Bounces and hits are marked; "
            "[ and ] go to the previous and next one. On a live rally the last button returns to now.",
            TIME_BAR,
        ),
        TourStep(
            "What to look at",
            "The live rally, the demo, and every recording of your own are in this list.",
            "Recording",
        ),
        TourStep(
            "Your own files",
            "Event files of Prophesee, iniVation and others, npz, CSV: choose one here, or drop it onto the page.",
            "Open file...",
        ),
        TourStep(
            "Five modes",
            "Watch a rally, Tune the detector, Label true balls, Train a policy, Export files. "
            "Each has a tour when you first open it.",
            "Mode",
        ),
        TourStep(
            "A first hour",
            "Six lessons on the demo recording: find, tune, compare, label, train, export. Each takes some minutes, "
            "and the app checks it. Press Lessons, now or later.",
            "Lessons",
        ),
    ),
    "Tune": (
        TourStep(
            "Inside the detector",
            "One window of one camera's events, and the ball that the detector finds in it. Zoom enlarges the "
            "picture and follows the ball.",
            PICTURE,
        ),
        TourStep(
            "Methods",
            "refined is the default. Every method shows its stages, from raw events to the ball (keys 1 to 7): "
            "what is green can be a ball, what is red shows which limit failed.",
            "Method",
        ),
        TourStep(
            "Thresholds",
            "Each slider is one setting of the method; picture and table update at once. Z undoes a change.",
            "Detector",
        ),
        TourStep(
            "Is it better?",
            "Score counts found and missed balls over the whole recording. Compare two configs, A and B, or other "
            "methods.",
            "Score",
        ),
    ),
    "Label": (
        TourStep(
            "Mark the true ball",
            "Click the ball: the click snaps to the circle that fits its events. The line shows where the other "
            "camera allows it.",
            PICTURE,
        ),
        TourStep("Who labels", "Labels carry your name, so that those of several people can be compared.", "Annotator"),
        TourStep(
            "Change a label",
            "Its centre, its size, and whether the ball is hidden or absent. Undo has no limit.",
            "State",
        ),
        TourStep(
            "Suggestions",
            'The detector proposes from here on, and you accept or correct; what looks wrong comes first. "Saved" '
            "means written to disk.",
            "Assistance",
        ),
    ),
    "Train": (
        TourStep(
            "A policy learns to return",
            "It learns where to turn the racket so that the ball lands on the target. Its training balls fly here.",
            PICTURE,
        ),
        TourStep(
            "Start", "Within a minute it learns to return and place balls. It continues if you leave.", "Train now"
        ),
        TourStep(
            "How well it does",
            "Return rate, landing error and reward while it learns; beside it the landings and every run.",
            "Curves",
        ),
        TourStep("Your own training", "Presets and all settings, each with an explanation.", "A new training"),
    ),
    "Export": (
        TourStep("Export files", "The open recording, or a training.", "What"),
        TourStep(
            "For which tool",
            "Rerun, a web page with the 3D scene, films and pictures, DSEC, EVT3, CSV and more.",
            "Format",
        ),
        TourStep("Made so far", "Files are written into the workspace, and can be downloaded here.", "Made so far"),
    ),
}


TOUR: Final = "tour"
"""Name of the stored hint: the tour was finished or skipped."""
BEGUN: Final = "tour begun"


class TourPage(Protocol):
    """The page's interface, with the browser's stored hints."""

    @property
    def is_new(self) -> bool: ...
    @property
    def has_link(self) -> bool: ...
    @property
    def seen(self) -> frozenset[str]: ...
    def note_seen(self, what: str) -> None: ...
    def listen(self, kind: str, listener: Callable[[Message], None]) -> None: ...
    def send(self, kind: str, values: Message) -> None: ...


class Tour:
    """The tour of one browser; used by the session's loop."""

    def __init__(self, page: TourPage) -> None:
        self._page = page
        seen = page.seen
        self._by_itself = not page.has_link and TOUR not in seen and (page.is_new or BEGUN in seen)
        self._done = {mode for mode in MODES if _of(mode) in seen}
        self._shown: ModeName | None = None
        self._mode: ModeName | None = None
        self._number = 0
        page.listen("tour", self._on_message)

    def tick(self, mode: ModeName, *, waits: bool = False) -> None:
        """Update for the chosen mode; one that `waits`, for a lesson, does not open by itself."""
        if mode == self._mode:
            return
        self._mode = mode
        if self._shown is not None:  # going on with the app finishes the tour
            self._note(self._shown)
        if self._by_itself and mode not in self._done and not waits:
            self._show(mode)
        elif self._shown is not None:
            self._show(None)

    def show(self) -> None:
        """Show the tour of a mode, even if it was seen before."""
        if self._mode is not None:
            self._show(self._mode)

    def _show(self, mode: ModeName | None) -> None:
        self._shown = mode
        self._number += 1
        steps: list[Json] = [] if mode is None else [[step.title, step.text, step.at] for step in TOURS[mode]]
        self._page.send("tour", {"number": self._number, "mode": mode or "", "steps": steps})
        if mode is not None and self._by_itself:
            self._page.note_seen(BEGUN)

    def _on_message(self, message: Message) -> None:
        if message.get("do") == "show":
            self.show()
            return
        if self._shown is None or message.get("number") != self._number:
            return
        shown, self._shown = self._shown, None
        if message.get("do") == "skip":
            self._by_itself = False
            self._page.note_seen(TOUR)
        elif message.get("do") == "done":
            self._note(shown)

    def _note(self, mode: ModeName) -> None:
        if mode not in self._done:
            self._done.add(mode)
            self._page.note_seen(_of(mode))


def _of(mode: ModeName) -> str:
    return f"tour of {mode}"
