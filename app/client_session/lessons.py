"""The six lessons on the demo recording: what to do, where, why, and how it is checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from app.client_session.lesson_checks import (
    GOOD_RECALL,
    GOOD_RETURNS,
    LABEL_ERROR_PX,
    LABELS,
    CheckResult,
    LessonFacts,
    check_compare,
    check_export,
    check_find,
    check_label,
    check_train,
    check_tune,
)
from app.client_session.tour import PICTURE, TIME_BAR
from app.formatting import percent
from app.state.client_state import ModeName
from core.metrics.score import MATCH_RADIUS_PX


@dataclass(frozen=True, slots=True)
class LessonStep:
    """One thing to do."""

    text: str
    at: str
    """Where, as in `TourStep`; it is framed."""
    opens: str = ""
    """Text on the folder or tab that is opened if it hides that place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lesson:
    """A lesson in one mode."""

    name: str
    title: str
    mode: ModeName
    why: str
    steps: tuple[LessonStep, ...]
    goal: str
    """What is checked, as the end of "Done when"."""
    check: Callable[[LessonFacts], CheckResult]
    on_demo: bool = True
    """Whether it is about the demo recording."""


LESSONS: Final = (
    Lesson(
        name="find",
        title="Find the ball",
        mode="Tune",
        why="All else is made of such answers, one a window. A bounce is hard: the shadow meets the ball.",
        steps=(
            LessonStep(
                "The circle is the ball that the method finds in 1 ms of events. Candidates, below, says how far it is "
                "from the true ball.",
                PICTURE,
            ),
            LessonStep("Choose the other camera, right.", "Camera"),
            LessonStep("Press ] or its button until the cursor stands at a bounce, a pale blue mark.", TIME_BAR),
        ),
        goal=f"the second camera shows a ball at a bounce, within {MATCH_RADIUS_PX:g} px of the true one",
        check=check_find,
    ),
    Lesson(
        name="tune",
        title="Tune a limit",
        mode="Tune",
        why="On your own recording some limit will not fit. The table names it; a score says whether a change helps.",
        steps=(
            LessonStep("Choose the method auto.", "Method"),
            LessonStep("Make a mistake: drag circularity min from 0.65 to 0.8.", "circularity min"),
            LessonStep(
                "Press this button: recall falls to about a half. In the tab Candidates, the verdicts that failed "
                "are links to their sliders.",
                "Score this config on the whole recording",
                "Score",
            ),
            LessonStep("Drag it back, or press Undo, and score again.", "circularity min"),
        ),
        goal=f"the method has a score with recall below {GOOD_RECALL:g}, and one above it with the shown settings",
        check=check_tune,
    ),
    Lesson(
        name="compare",
        title="Compare two methods",
        mode="Tune",
        why="A figure for the whole recording does not say where a method fails. Looking there does.",
        steps=(
            LessonStep("auto and refined are ticked. Press Compare over time.", "Compare over time", "Compare methods"),
            LessonStep(
                "Recall, error and time of both stand on the left. Under Look at, choose auto, missed, and one of the "
                "buttons: the cursor goes to a ball that auto missed.",
                "Look at",
            ),
        ),
        goal="two methods are compared with the truth, and the cursor is at a ball that one of them missed",
        check=check_compare,
    ),
    Lesson(
        name="label",
        title="Label true balls",
        mode="Label",
        why="Your own recordings have no truth. Labels take its place, in scores and in Auto-tune.",
        steps=(
            LessonStep(
                "Click the ball in the large picture; it snaps to the events. The first click asks for your name. "
                "Key 7 zooms.",
                PICTURE,
            ),
            LessonStep("N goes to the next time, Z undoes. Click the ball again.", "Label every"),
            LessonStep(
                "Or let the detector propose from here on: space accepts a ball, R rejects it.",
                "Propose from here on (I)",
            ),
        ),
        goal=f"{LABELS} balls or more are labelled and saved, at most {LABEL_ERROR_PX:g} px off the true ones (median)",
        check=check_label,
    ),
    Lesson(
        name="train",
        title="Train a policy",
        mode="Train",
        why="The detector serves a robot that has to return the ball to a target. It learns that in the simulation.",
        steps=(
            LessonStep("Press Train now. It takes about a minute, and goes on if you leave.", "Train now"),
            LessonStep("In Curves the return rate rises and the landing error falls. Pace slows it down.", "Pace"),
        ),
        goal=f"the shown run was evaluated, and returned {percent(GOOD_RETURNS)} of the balls or more",
        check=check_train,
        on_demo=False,
    ),
    Lesson(
        name="export",
        title="Export a file",
        mode="Export",
        why="Figures, papers and other programs need files: what you see here goes to Rerun, DSEC, EVT3, CSV and more.",
        steps=(
            LessonStep("Press 2 s here: a short part is made quickly.", "Take"),
            LessonStep("Choose a format. Rerun has pictures, the 3D scene and the detector's stages.", "Format"),
            LessonStep("Press Export. The file is listed under Made so far, where it can be downloaded.", "Export"),
        ),
        goal="a file of the demo was written by this browser",
        check=check_export,
    ),
)
