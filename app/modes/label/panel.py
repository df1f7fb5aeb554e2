"""The controls of Label mode: they send what a person chose, and show what they are given."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import viser

from app.formatting import html_text
from app.modes.label.keys import KEYS, label_keys_html
from app.modes.label.labelling import DEFAULT_ANNOTATOR, LABEL_STEPS_US, WINDOWS_US, ZOOMS, LabelView, UnfitClick
from app.panels.time_bar import step_label
from app.state.client_state import SPACE_COLOURS
from app.widgets import Choice, Listing, when_changed, when_clicked, when_triggered
from labels.model import Label, LabelState

STATE_NAMES: Final = {
    "visible": "visible",
    "partly": "partly occluded",
    "occluded": "occluded",
    "out_of_frame": "out of frame",
    "no_ball": "no ball",
}
"""Act -> what its button says."""

NOWHERE: Final = (math.nan, math.nan, math.nan)
"""Numbers of what has no place: the page leaves fields with NaN empty."""

ANNOTATOR: Final = "Annotator"
"""Label of the field with the annotator's name."""
FLAT, IN_SPACE = "Picture", "3D"
SPACE_HINT: Final = "3D: the events of the window and its neighbours in space and time, with the labels"
SPACE_COLOUR_HINT: Final = (
    "What Tune's method makes of its window round the cursor: the stage that Tune shows, each candidate, green and red "
    "candidates; or ON and OFF. A second look has ON and OFF only"
)
ACCEPT_ALL_HINT: Final = "Accepts the proposals at this time. Labels in two cameras propose the ball in all others"

RAYS_HINT: Final = "Shows the lines on which the other cameras see the ball, and how well all agree"
BUTTONS: Final = (
    (
        "Accept steady segment (Enter)",
        "accept_segment",
        viser.Icon.CHECKS,
        "The proposals around the cursor, as long as they lie on one smooth path",
    ),
    (
        "Accept whole flight (Shift space)",
        "accept_flight",
        viser.Icon.PLAYER_TRACK_NEXT,
        "The proposals of one flight, in all cameras that agree; needs two calibrated ones",
    ),
    (
        "Interpolate (Shift I)",
        "interpolate",
        viser.Icon.VECTOR_SPLINE,
        "Labels the unchecked times between your labels around the cursor",
    ),
    (
        "Next to check (K)",
        "suspicious",
        viser.Icon.ALERT_TRIANGLE,
        "Goes to the label, proposal or gap that is most probably wrong, and says why",
    ),
    (
        "Second look (Shift K)",
        "blind",
        viser.Icon.EYE_OFF,
        "Asks for a label again without showing the first one: it measures how exact you are",
    ),
)
"""Label, act, icon and hint of the buttons that help."""


@dataclass(frozen=True, slots=True)
class PanelActions:
    """What a person can ask for; called from viser's loop."""

    act: Callable[[str], None]
    """An act by its name, as a key would."""
    change: Callable[..., None]
    """Other values of `LabelView`."""
    name: Callable[[str], None]
    step: Callable[[int], None]
    numbers: Callable[[float, float, float | None], None]


class LabelPanel:
    """Built once for one browser."""

    def __init__(self, gui: viser.GuiApi, actions: PanelActions) -> None:
        self._actions = actions
        self.folder = gui.add_folder(None, visible=False)
        with self.folder:
            self._save = gui.add_html("")
            self._progress = gui.add_html("")
            self._here = gui.add_html("")
            self._add_view(gui)
            self._add_label(gui)
            # In sight in a window of 720 px, before what keys and the mouse do as well.
            self.contacts = gui.add_folder(None)
            self._add_numbers(gui)
            self._add_assistance(gui)
            with gui.add_folder("Keys", expand_by_default=False):
                gui.add_html(label_keys_html())
        self._commands: list[viser.CommandHandle] = []
        for key, modifier, name, text in KEYS:
            command = gui.add_command(f"Label: {text}", hotkey=key, modifier=modifier, disabled=True)  # type: ignore[arg-type]
            when_triggered(command, lambda name=name: actions.act(name))
            self._commands.append(command)

    def listen_to_keys(self, listening: bool) -> None:
        """Only in Label: elsewhere a key of ours, such as Enter, would not reach the button that has the focus."""
        for command in self._commands:
            command.disabled = not listening

    def _add_view(self, gui: viser.GuiApi) -> None:
        actions = self._actions
        self._annotator = gui.add_text(ANNOTATOR, DEFAULT_ANNOTATOR, hint="Annotator. Each name has its own layer")
        self._camera = Listing(
            gui, "Camera", lambda name: actions.change(camera=name), hint="Key 0: the next one; or click its picture"
        )
        windows = tuple(f"{window / 1e3:g}" for window in WINDOWS_US)
        self._window = Choice(gui, "Window [ms]", windows, self._choose_window, hint="Keys 1 to 5")
        zooms = tuple("whole" if zoom == 1 else f"{zoom:g}x" for zoom in ZOOMS)
        self._zoom = Choice(gui, "Zoom", zooms, self._choose_zoom, hint="Keys 6 to 9")
        self._space = Choice(
            gui, "Show", (FLAT, IN_SPACE), lambda value: actions.change(in_space=value == IN_SPACE), hint=SPACE_HINT
        )
        self._space_colour = Choice(
            gui, "Colour", SPACE_COLOURS, lambda value: actions.change(space_colour=value), hint=SPACE_COLOUR_HINT
        )
        self._space_note = gui.add_html("", visible=False)
        self._step = gui.add_dropdown(
            "Label every", [step_label(step) for step in LABEL_STEPS_US], hint="Step between the times to label"
        )
        self._named = DEFAULT_ANNOTATOR
        """The annotator that the field was last told."""
        when_changed(self._annotator, lambda value: actions.name(str(value)))
        when_changed(self._step, lambda value: actions.step(_step_of(str(value))))

    def _add_label(self, gui: viser.GuiApi) -> None:
        actions = self._actions
        with gui.add_folder("Label"):
            self._state = Choice(gui, "State", tuple(STATE_NAMES.values()), self._choose_state)
            row = gui.add_button_group("Change", ("Copy previous", "Clear"))
            # Buttons of their own: viser's rows of buttons are grey only as a whole.
            self._undo = gui.add_button("Undo (Z)", icon=viser.Icon.ARROW_BACK_UP, disabled=True)
            self._redo = gui.add_button("Redo (Shift Z)", icon=viser.Icon.ARROW_FORWARD_UP, disabled=True)

        @row.on_click
        async def _(event: viser.GuiEvent) -> None:
            actions.act({"Copy previous": "copy", "Clear": "clear"}[str(event.target.value)])

        when_clicked(self._undo, lambda: actions.act("undo"))
        when_clicked(self._redo, lambda: actions.act("redo"))

    def _add_numbers(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Centre and radius"):
            self._centre = gui.add_vector2("Centre [px]", (0.0, 0.0), step=0.01, hint="Y G H B nudge it by 0.25 px")
            self._radius = gui.add_number("Radius [px]", 0.0, min=0.0, step=0.05, hint="0: not known")
        for handle in (self._centre, self._radius):
            when_changed(handle, lambda _: self._send_numbers())

    def _add_assistance(self, gui: viser.GuiApi) -> None:
        actions = self._actions
        with gui.add_folder("Assistance"):
            self._snap = gui.add_checkbox(
                "Snap clicks to the events", True, hint="A click becomes the circle that fits the events there"
            )
            self._advance = gui.add_checkbox(
                "Next time after each label", False, hint="After a click or a key that labels"
            )
            self._follow = gui.add_checkbox(
                "Zoom follows the ball", True, hint="Off: a zoomed picture stays where it is"
            )
            self._epipolar = gui.add_checkbox("Other cameras' rays", True, hint=RAYS_HINT)
            self._propose = gui.add_button("Propose from here on (I)", icon=viser.Icon.WAND, color="teal")
            self._proposals = gui.add_html("")
            for label, name, icon, hint in BUTTONS:
                when_clicked(gui.add_button(label, icon=icon, hint=hint), lambda name=name: actions.act(name))
            self._accept_all = gui.add_button(
                "Accept in all cameras (Shift U)", icon=viser.Icon.CHECKBOX, visible=False, hint=ACCEPT_ALL_HINT
            )
        when_clicked(self._accept_all, lambda: actions.act("accept_all"))
        when_clicked(self._propose, lambda: actions.act("propose"))
        for field, handle in (
            ("snap", self._snap),
            ("advance", self._advance),
            ("follow", self._follow),
            ("epipolar", self._epipolar),
        ):
            when_changed(handle, lambda value, field=field: actions.change(**{field: bool(value)}))

    def offer_cameras(self, names: Sequence[str]) -> None:
        """Cameras of the recording."""
        self._camera.offer(tuple(names))
        self._accept_all.visible = len(names) > 2

    def show_view(self, view: LabelView, step_us: int) -> None:
        """Let the controls follow what was chosen."""
        if view.annotator != self._named:  # else somebody may be typing another
            self.show_name(view.annotator)
        self._camera.show(view.camera)
        self._window.show(f"{view.window_us / 1e3:g}")
        self._zoom.show("whole" if view.zoom == 1 else f"{view.zoom:g}x")
        self._space.show(IN_SPACE if view.in_space else FLAT)
        self._space_colour.show(view.space_colour)
        self._space_note.visible = self._space_colour.visible = view.in_space
        if step_us in LABEL_STEPS_US:
            self._step.value = step_label(step_us)
        self._snap.value, self._advance.value = view.snap, view.advance
        self._follow.value, self._epipolar.value = view.follow, view.epipolar

    def show_space_note(self, text: str) -> None:
        """Say which events are shown in space and time."""
        self._space_note.content = f"<div style='font-size:12px;padding:0 12px'>{html_text(text)}</div>"

    def show_name(self, name: str | None = None) -> None:
        """Let the annotator's field show this name; without one, the name that it showed before another was typed."""
        self._named = name or self._named
        self._annotator.value = self._named

    def field_left(self, name: object, text: object) -> None:
        """A field was left with the text that it had: typed or confirmed, that of the annotator is a name given."""
        if name == ANNOTATOR and text == self._named:
            self._actions.name(self._named)

    def show_label(self, label: Label | None, asking: UnfitClick | None) -> None:
        """Numbers and state at the cursor; of a click that waits for its radius, the centre."""
        x_px, y_px, self._radius.value = shown_numbers(label, asking)
        self._centre.value = x_px, y_px
        self._state.show("" if label is None else label.state.replace("_", " "))

    def show_undo(self, *, can_undo: bool, can_redo: bool) -> None:
        """Whether there is something to take back, or to bring back."""
        self._undo.disabled, self._redo.disabled = not can_undo, not can_redo

    def show_save(self, text: str) -> None:
        """Whether everything is on the disk."""
        self._save.content = text

    def show_progress(self, text: str) -> None:
        """How far the work is."""
        self._progress.content = text

    def show_here(self, text: str) -> None:
        """What is known at the cursor."""
        self._here.content = text

    def show_proposals(self, text: str, running: bool) -> None:
        """What the detector has found so far."""
        self._proposals.content = text
        self._propose.label = "Stop proposing (I)" if running else "Propose from here on (I)"

    def _choose_window(self, text: str) -> None:
        self._actions.act(f"window_{[f'{window / 1e3:g}' for window in WINDOWS_US].index(text)}")

    def _choose_zoom(self, text: str) -> None:
        names = ["whole" if zoom == 1 else f"{zoom:g}x" for zoom in ZOOMS]
        self._actions.act(f"zoom_{names.index(text)}")

    def _choose_state(self, text: str) -> None:
        self._actions.act(next(name for name, shown in STATE_NAMES.items() if shown == text))

    def _send_numbers(self) -> None:
        x, y, r = *self._centre.value, self._radius.value
        if all(map(math.isfinite, (x, y, r))):  # else a label would be placed before all three are typed
            self._actions.numbers(x, y, r or None)


def shown_numbers(label: Label | None, asking: UnfitClick | None) -> tuple[float, float, float]:
    """Centre x, y and radius, px, in the fields: of the label, else of a click that waits for its radius; or `NOWHERE`.

    A radius of 0 is not known.
    """
    if asking is not None:
        return round(asking.x_px, 3), round(asking.y_px, 3), 0.0
    if label is None or label.x_px is None or label.y_px is None:
        return NOWHERE
    return round(label.x_px, 3), round(label.y_px, 3), round(label.r_px or 0.0, 3)


def _step_of(text: str) -> int:
    return next(step for step in LABEL_STEPS_US if step_label(step) == text)


assert set(STATE_NAMES.values()) == {state.replace("_", " ") for state in LabelState}
