"""What the tour says: a few steps for each mode, each about one thing on the page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from app.state.client_state import ModeName

PICTURE: Final = "picture"
"""The middle of the window."""
TIME_BAR: Final = "#rallyscope-bar"


@dataclass(frozen=True, slots=True)
class TourStep:
    """One card."""

    title: str
    text: str
    at: str
    """What it speaks of: `PICTURE`, the #id of an element of ours, or the words that stand on it."""


TOURS: Final[Mapping[ModeName, tuple[TourStep, ...]]] = {
    "Watch": (
        TourStep(
            "A rally, seen by two event cameras",
            "Two cameras that report only changes of brightness watch the ball. From their events it is found, placed "
            "in space, and its flight is predicted: pale blue before the bounce, cyan after it, in a tube of two "
            "standard deviations. The racket goes where the prediction says. Drag to turn the view, wheel to come "
            "closer.",
            PICTURE,
        ),
        TourStep(
            "Time",
            "Play, step, or drag along the line. Slow motion goes down to 1/1000. Bounces and hits are marked; "
            "[ and ] go from one to the next. On a live rally the last button leads back to now.",
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
            "Watch what happens, Tune the detector, Label true balls, Train a policy, Export files. "
            "Each shows you round when you first open it.",
            "Mode",
        ),
    ),
    "Tune": (
        TourStep(
            "Inside the detector",
            "One window of one camera's events, and the ball that the detector finds in it. Zoom comes closer and "
            "follows the ball.",
            PICTURE,
        ),
        TourStep(
            "Methods",
            "refined is the default. auto and paper show their stages, from raw events to the ball (keys 1 to 6): "
            "green hulls pass as a ball, red ones say which number fails.",
            "Method",
        ),
        TourStep(
            "Thresholds",
            "Each slider is one setting of the method, and picture and table follow it at once. Z takes a change back.",
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
            "Say where the ball really is",
            "Click the ball: the click snaps to the circle that fits its events. The line is where the other camera "
            "allows it.",
            PICTURE,
        ),
        TourStep("Who labels", "Labels carry your name, so that those of several people can be compared.", "Annotator"),
        TourStep(
            "Change a label",
            "Its centre, its size, and whether the ball is hidden or absent. Undo has no limit.",
            "State",
        ),
        TourStep(
            "Let the machine propose",
            "The detector proposes from here on, and you accept or correct; what looks wrong comes first. Everything "
            "is on the disk before it is called saved.",
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
            "Start", "Within a minute it goes from missing to placing balls. It goes on without you.", "Train now"
        ),
        TourStep(
            "How well it does",
            "Return rate, landing error and reward while it learns; beside it the landings and every run.",
            "Curves",
        ),
        TourStep("Your own training", "Presets and every setting, each with what it means.", "A new training"),
    ),
    "Export": (
        TourStep("Take it away", "The recording that is open, or a training.", "What"),
        TourStep(
            "For which tool",
            "Rerun, a web page with the 3D scene, films and pictures, DSEC, EVT3, CSV and more.",
            "Format",
        ),
        TourStep("Made so far", "Files are written into the workspace, and can be downloaded here.", "Made so far"),
    ),
}
