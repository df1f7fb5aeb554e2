"""Texts of the tour: a few steps for each mode, each about one thing on the page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from app.state.client_state import ModeName

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
            "refined is the default. auto and paper show their stages, from raw events to the ball (keys 1 to 6): "
            "green hulls can be a ball, red ones show which limit failed.",
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
