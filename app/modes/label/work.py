"""What one browser labels: cursor, choices, labels as they are on the disk, and everything a person can do to them.

It knows no controls and draws nothing. All methods are called by the loop; answers of the desk come through `later`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.modes.label.label_changes import (
    ShownPicture,
    accepted,
    copied,
    label_from_click,
    moved,
    placed,
    snapped,
    with_state,
)
from app.modes.label.label_writer import Act, LabelWriter, LayerName, Saved
from app.modes.label.plan import CameraWork, PicturePlan
from app.modes.label.sources import LabelSource, partner_of, sources_of
from app.modes.label.view import BIG_NUDGE_PX, NUDGE_PX, RADIUS_STEP_PX, Grid, LabelView
from app.shared.workspace import slug_from
from core.errors import LabelError
from core.events import Events
from core.recordings import Recording
from labels.model import Label, LabelState
from labels.store import LabelStore
from labels.store_registry import LabelStoreRegistry

SNAP_REACH_US: Final = 17_000
RECENT: Final = 64
NUDGES: Final = {"up": (0, -1), "down": (0, 1), "left": (-1, 0), "right": (1, 0)}
STATES: Final = {
    "no_ball": LabelState.NO_BALL,
    "out_of_frame": LabelState.OUT_OF_FRAME,
    "visible": LabelState.VISIBLE,
    "partly": LabelState.PARTLY_OCCLUDED,
    "occluded": LabelState.OCCLUDED,
}
Make = Callable[[Label | None], Label | None]
"""From the label that is there to the one that is to be there; None: impossible."""


@dataclass(frozen=True, slots=True)
class LabelCallbacks:
    """What the work needs of its browser."""

    later: Callable[[Callable[[], None]], None]
    report: Callable[[Exception], None]
    note: Callable[[str, str, str], None]
    seek: Callable[[int], None]


class LabelWork:
    """The labelling of one browser, one recording at a time."""

    def __init__(
        self, registry: LabelStoreRegistry, recording: Recording, hooks: LabelCallbacks, view: LabelView, step_us: int
    ) -> None:
        self.recording = recording
        self.sources = sources_of(recording)
        self.hooks = hooks
        names = tuple(self.sources)
        camera = view.camera if view.camera in names else names[0]
        self.view = replace(view, camera=camera, blind=False, centre_px=None)
        self.step_us = step_us
        self.works: dict[str, CameraWork] = {name: CameraWork() for name in names}
        self.ready: set[str] = set()
        """Cameras whose labels have been read."""
        self.saved: dict[str, Saved] = {}
        self.breaks_us: tuple[int, ...] = ()
        self.t_us = 0
        self.shown: PicturePlan | None = None
        """What is on the screen."""
        self.recent_us: list[int] = []
        self.decisions = 0
        self.back_us = 0
        """Where a second look was begun."""
        self.desk = LabelWriter(registry, recording.uuid)
        self._arrived_s = time.monotonic()
        self.open_layers()

    # What there is ------------------------------------------------------------------------------------------------

    @property
    def source(self) -> LabelSource:
        """The camera that is labelled."""
        return self.sources[self.view.camera]

    @property
    def partner(self) -> LabelSource | None:
        """The camera beside it."""
        return partner_of(self.sources, self.view.camera)

    @property
    def here(self) -> CameraWork:
        """What is known in the camera that is labelled."""
        return self.works[self.view.camera]

    @property
    def grid(self) -> Grid:
        """The times that are to be labelled."""
        return Grid(self.recording.duration_us, self.step_us, self.source.frames_us)

    @property
    def layer(self) -> LayerName:
        """The layer that labels are written to."""
        return LayerName(self.view.camera, self.view.annotator, self.view.blind)

    @property
    def on_screen(self) -> bool:
        """What the cursor points at is what the person sees: only that can be judged."""
        return self.shown is not None and self.shown.t_us == self.t_us and self.shown.main.camera == self.view.camera

    # Choices ------------------------------------------------------------------------------------------------------

    def change_view(self, **changes: object) -> None:
        """Take over other choices of what is shown."""
        before = self.view
        self.view = replace(before, **changes)  # type: ignore[arg-type]
        if self.view.camera not in self.sources:
            self.view = before
        if (self.view.annotator, self.view.camera) != (before.annotator, before.camera):
            self.view = replace(self.view, blind=False, centre_px=None)
        if self.view.annotator != before.annotator:
            self.ready.clear()
            self.open_layers()

    def call_annotator(self, name: str) -> None:
        """Another person labels. Raises CommandError for a name that cannot be used; one not typed yet is no name."""
        if name.strip():
            self.change_view(annotator=slug_from(name))

    def open_layers(self) -> None:
        """Read the labels of every camera, the one that is labelled first; a partner's are looked at only."""
        for camera in sorted(self.sources, key=lambda name: name != self.view.camera):
            layer = LayerName(camera, self.view.annotator)
            self.desk.look(layer, self._later_saved, self._later_failed)

    def move_to(self, t_us: int) -> None:
        """The time cursor was moved, by a key or by the time controls."""
        if t_us != self.t_us:
            self.t_us = t_us
            self._arrived_s = time.monotonic()

    def go(self, t_us: int) -> None:
        """Move the time cursor."""
        self.move_to(t_us)
        self.hooks.seek(t_us)

    def step(self, steps: int) -> None:
        """To the next or previous time that is to be labelled, or some further."""
        self.go(self.grid.moved(self.t_us, steps))

    # Acts ---------------------------------------------------------------------------------------------------------

    def click(self, x_px: float, y_px: float) -> None:
        """The ball is here, in the picture that is shown."""
        if self.shown is None or self.shown.main.camera != self.view.camera:
            return
        t_us, shown_picture, source = self.shown.t_us, self.shown_picture(self.shown), self.source
        draft = None if self.view.blind else self.here.draft(t_us)
        snap = self.view.snap and source.stream is not None

        def make(before: Label | None) -> Label:
            label = label_from_click(x_px, y_px, shown_picture, before, draft)
            return snapped(label, _near(source, t_us)) if snap else label

        self.change_label(t_us, make, advance=self.view.advance)

    def draw_circle(self, x_px: float, y_px: float, r_px: float) -> None:
        """Centre and radius drawn by hand."""
        if self.shown is None or not r_px > 0 or self.shown.main.camera != self.view.camera:
            return
        t_us, shown_picture = self.shown.t_us, self.shown_picture(self.shown)
        draft = None if self.view.blind else self.here.draft(t_us)
        self.change_label(
            t_us,
            lambda before: label_from_click(x_px, y_px, shown_picture, before, draft, r_px=r_px),
            advance=self.view.advance,
        )

    def set_numbers(self, x_px: float, y_px: float, r_px: float | None) -> None:
        """Position and radius typed in."""
        shown_picture = self.shown_picture()

        def make(before: Label | None) -> Label:
            if before is None:
                return label_from_click(x_px, y_px, shown_picture, None, None, r_px=r_px)
            return placed(before, x_px, y_px, r_px, shown_picture)

        self.change_label(self.t_us, make)

    def accept(self) -> None:
        """What is proposed here is right; go on. Where nothing is proposed, only go on."""
        if not self.on_screen:
            return
        draft = None if self.view.blind else self.here.draft(self.t_us)
        if draft is not None:
            label = accepted(draft, self.shown_picture())
            self.change_label(self.t_us, lambda before: before or label)
        self.step(+1)

    def reject(self) -> None:
        """What is proposed here is wrong; it is not shown any more."""
        if self.on_screen and self.here.draft(self.t_us) is not None:
            work = self.here
            self.works[self.view.camera] = replace(work, rejected=work.rejected | {self.t_us})
            self.decisions += 1

    def nudge(self, direction: str, by_px: float) -> None:
        """Move the label a little."""
        dx, dy = NUDGES[direction]
        shown_picture = self.shown_picture()
        self.change_label(
            self.t_us, lambda before: moved(before, dx * by_px, dy * by_px, shown_picture) if before else None
        )

    def resize(self, by_px: float) -> None:
        """Make the radius larger or smaller."""
        shown_picture = self.shown_picture()

        def make(before: Label | None) -> Label | None:
            if before is None or before.x_px is None or before.y_px is None:
                return None
            return placed(before, before.x_px, before.y_px, max((before.r_px or 5.0) + by_px, 0.5), shown_picture)

        self.change_label(self.t_us, make)

    def set_state(self, state: LabelState) -> None:
        """Say what is seen; go on after the states that need no position."""
        shown_picture, t_us = self.shown_picture(), self.t_us
        draft = None if self.view.blind else self.here.draft(t_us)
        away = state in (LabelState.NO_BALL, LabelState.OUT_OF_FRAME)
        self.change_label(t_us, lambda before: with_state(state, before, draft, shown_picture), advance=away)

    def copy_previous(self) -> None:
        """The latest label before this time, here too."""
        shown_picture, t_us = self.shown_picture(), self.t_us

        def act(store: LabelStore) -> tuple[int, ...]:
            earlier = store.labels().between(0, t_us)
            label = store.at(int(earlier.t_us[-1])) if len(earlier) else None
            if label is None:
                raise LabelError("no label before this time", where=f"{t_us} us")
            store.put(copied(label, shown_picture))
            return (t_us,)

        self.carry_out(act)

    def snap_label(self) -> None:
        """Move the label to the circle that fits the events."""
        t_us, source = self.t_us, self.source
        near = lambda: _near(source, t_us)  # noqa: E731 - read where it is used, off the loop
        self.change_label(t_us, lambda before: snapped(before, near()) if before and before.x_px is not None else None)

    def clear(self) -> None:
        """Make a time unchecked again."""
        t_us = self.t_us
        self.carry_out(lambda store: (t_us,) if store.delete(t_us) else ())

    def undo(self) -> None:
        """Take the latest change back, and show it."""
        self.carry_out(lambda store: store.undo(), show=True)

    def redo(self) -> None:
        """Bring back what was undone, and show it."""
        self.carry_out(lambda store: store.redo(), show=True)

    def toggle_break(self) -> None:
        """A bounce or hit at this time, or no longer. Kept while the recording is open in this browser."""
        here = {self.t_us}
        self.breaks_us = tuple(sorted(set(self.breaks_us) ^ here))

    def perform(self, name: str) -> bool:
        """An act of the keyboard by its name; False if it is none of these."""
        big = name.endswith("_more")
        direction = name.removesuffix("_more")
        if direction in NUDGES:
            self.nudge(direction, BIG_NUDGE_PX if big else NUDGE_PX)
        elif name in STATES:
            self.set_state(STATES[name])
        elif name in ("larger", "smaller"):
            self.resize(RADIUS_STEP_PX if name == "larger" else -RADIUS_STEP_PX)
        else:
            act = self._acts().get(name)
            if act is None:
                return False
            act()
        return True

    def _acts(self) -> dict[str, Callable[[], None]]:
        return {
            "accept": self.accept,
            "reject": self.reject,
            "next": lambda: self.step(+1),
            "previous": lambda: self.step(-1),
            "ten_on": lambda: self.step(+10),
            "ten_back": lambda: self.step(-10),
            "first": lambda: self.go(int(self.grid.times()[:1].sum())),
            "last": lambda: self.go(self.grid.last_us),
            "unchecked": self.next_unchecked,
            "copy": self.copy_previous,
            "snap": self.snap_label,
            "clear": self.clear,
            "undo": self.undo,
            "redo": self.redo,
            "break": self.toggle_break,
        }

    def next_unchecked(self) -> None:
        """To the next time that nobody has looked at; round to the start once."""
        times = self.grid.times()
        left = times[~np.isin(times, self.here.arrays.t_us)]
        if not len(left):
            self.hooks.note("Everything is checked", "No unchecked time is left in this camera.", "green")
            return
        self.go(int(left[int(np.searchsorted(left, self.t_us, side="right")) % len(left)]))

    # Saving -------------------------------------------------------------------------------------------------------

    def shown_picture(self, plan: PicturePlan | None = None) -> ShownPicture:
        """The picture that is being judged."""
        shown = plan or self.shown
        spent_ms = round(1e3 * (time.monotonic() - self._arrived_s))
        if shown is None or (plan is None and shown.t_us != self.t_us):
            return ShownPicture(self.t_us, (self.t_us, self.t_us + 1), "", spent_ms)
        rendering = "frame" if shown.main.frame is not None else shown.main.rendering.replace(" ", "_")
        return ShownPicture(shown.t_us, shown.main.window_us, rendering, spent_ms)

    def change_label(self, t_us: int, make: Make, *, advance: bool = False) -> None:
        """Replace the label at a time by what is made of it, off the loop and after all earlier changes."""

        def act(store: LabelStore) -> tuple[int, ...]:
            before = store.at(t_us)
            label = make(before)
            if label is None:
                raise LabelError("nothing to change at this time", where=f"{t_us} us", remedy="click the ball first")
            if label != before:
                store.put(label)
            return (t_us,)

        self.carry_out(act)
        if advance and t_us == self.t_us and not self.view.blind:
            self.step(+1)

    def carry_out(self, act: Act, *, show: bool = False) -> None:
        """Let the desk do it."""
        self.decisions += 1

        def done(saved: Saved) -> None:
            self.hooks.later(lambda: self.take(saved, show=show))

        self.desk.act(self.layer, act, done, self._later_failed)

    def close(self) -> None:
        """The browser or the recording is gone; what was asked for is still saved."""
        self.desk.close()

    def _later_saved(self, saved: Saved) -> None:
        self.hooks.later(lambda: self.take(saved))

    def _later_failed(self, error: Exception) -> None:
        self.hooks.later(lambda: self.hooks.report(error))

    def take(self, saved: Saved, *, show: bool = False) -> None:
        """The desk's answer: it is on the disk."""
        layer = saved.layer
        if layer.annotator != self.view.annotator:
            return
        if layer.blind:
            if saved.touched_us and self.view.blind:
                self.change_view(blind=False)
                self.go(self.back_us)
            return
        if layer.camera not in self.ready:
            self.ready.add(layer.camera)
            for note in saved.notes:
                self.hooks.note("Labels", note, "yellow")
        self.saved[layer.camera] = saved
        self.works[layer.camera] = replace(self.works[layer.camera], labels=saved.labels, arrays=saved.arrays)
        self.recent_us = [*self.recent_us, *saved.touched_us[-RECENT:]][-RECENT:]
        if show and len(saved.touched_us) and layer.camera == self.view.camera:
            self.go(min(saved.touched_us, key=lambda t_us: abs(t_us - self.t_us)))


def _near(source: LabelSource, t_us: int) -> Events:
    return source.events(max(t_us - SNAP_REACH_US, 0), t_us + SNAP_REACH_US)
