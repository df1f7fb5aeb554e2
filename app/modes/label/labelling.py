"""What one browser labels, as frozen values: its choices, the cursor, and what is known of the ball in each camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.modes.label.comparison import LabelComparison
from app.modes.label.label_changes import ProposedLabel, ShownPicture, proposed_at
from app.modes.label.label_picture import PicturePlan
from app.modes.label.label_writer import Saved
from app.modes.label.sources import LabelSource, others_of, sources_of
from app.state.client_state import STEPS_US, SpaceColour
from core.cameras import Camera
from core.recordings import Recording
from labels.arrays import LabelArrays, label_arrays
from labels.assist import Proposals
from labels.conflicts import settlement
from labels.model import ContactLabel, Label
from labels.store import Layer

WINDOWS_US: Final = (500, 1_000, 2_000, 5_000, 10_000)
"""Keys 1 to 5."""
ZOOMS: Final = (1.0, 5.0, 10.0, 20.0)
"""Keys 6 to 9."""
LABEL_STEPS_US: Final = tuple(step for step in STEPS_US if 500 <= step <= 100_000)
DEFAULT_STEP_US: Final = 2_000
NUDGE_PX: Final = 0.25
BIG_NUDGE_PX: Final = 1.0
RADIUS_STEP_PX: Final = 0.25
DEFAULT_ANNOTATOR: Final = "annotator"
NEAR_US: Final = 60_000
"""Labels farther away say nothing about where the ball is now."""
Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class LabelView:
    """What one browser looks at in Label."""

    camera: str = ""
    annotator: str = DEFAULT_ANNOTATOR
    window_us: int = 2_000
    zoom: float = 1.0
    snap: bool = True
    """Move clicks to the circle that fits the events."""
    advance: bool = False
    """Go on after each label that is made by a click or a key."""
    follow: bool = True
    """Keep the ball, as far as it is known, in the middle of a zoomed picture."""
    epipolar: bool = True
    """Show the other cameras' rays, where they have the ball together, and how well they agree."""
    centre_px: tuple[float, float] | None = None
    """Centre of a zoomed picture, where nothing is known of the ball."""
    in_space: bool = False
    """Show the events round the cursor in space and time instead of as pictures."""
    space_colour: SpaceColour = "polarity"
    """What colours them. Not what the detector says, as in Tune, before one asks for that: a label is one's own."""
    repeat: bool = False
    """A repeat annotation: the label is asked for again, without showing it."""


def window_around(t_us: int, window_us: int) -> tuple[int, int]:
    """The window whose middle is the label's time: a label is the ball at the middle of what is seen."""
    start_us = max(t_us - window_us // 2, 0)
    return start_us, max(t_us + (window_us + 1) // 2, start_us + 1)


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """The times that are to be labelled: those of the frames, or every so many microseconds."""

    duration_us: int
    step_us: int
    frames_us: NDArray[np.int64] | None = None

    def moved(self, t_us: int, steps: int) -> int:
        """The time so many steps on (or back) from any time; stays inside."""
        if self.frames_us is not None:
            if not len(self.frames_us):
                return t_us
            at = int(np.searchsorted(self.frames_us, t_us, side="right" if steps > 0 else "left"))
            row = at - 1 + steps if steps > 0 else at + steps
            return int(self.frames_us[min(max(row, 0), len(self.frames_us) - 1)])
        number = t_us // self.step_us if steps > 0 else -(-t_us // self.step_us)
        return min(max((number + steps) * self.step_us, 0), self.last_us)

    def nearest(self, t_us: int) -> int:
        """The time to be labelled that is next to any time; that time where there is none."""
        before_us, after_us = self.moved(t_us + 1, -1), self.moved(t_us - 1, +1)
        if self.frames_us is not None and not len(self.frames_us):
            return t_us
        return before_us if abs(before_us - t_us) <= abs(after_us - t_us) else after_us

    @property
    def last_us(self) -> int:
        """The last time that can be labelled."""
        if self.frames_us is not None:
            return int(self.frames_us[-1]) if len(self.frames_us) else 0
        return max(self.duration_us - 1, 0) // self.step_us * self.step_us

    def times(self) -> NDArray[np.int64]:
        """All times that can be labelled; none in an empty recording."""
        if self.frames_us is not None:
            return self.frames_us
        return np.arange(0, self.duration_us, self.step_us, dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class CameraWork:
    """What is known of the ball in one camera. Replaced, never changed."""

    labels: Mapping[int, Label] = field(default_factory=dict)
    arrays: LabelArrays = field(default_factory=lambda: label_arrays(()))
    proposals: Proposals | None = None
    rejected: frozenset[tuple[int, str]] = frozenset()
    """(time, detector) of proposals that were found wrong."""
    contacts: tuple[ContactLabel, ...] = ()
    """Bounces, hits and net touches of the camera's layer, by time."""
    no_contacts_us: tuple[int, ...] = ()
    """Times at which one was proposed and found wrong, ascending."""

    def draft(self, t_us: int) -> ProposedLabel | None:
        """What is proposed where nothing is labelled or rejected."""
        if self.proposals is None or t_us in self.labels or (t_us, self.proposals.detector) in self.rejected:
            return None
        return proposed_at(self.proposals, t_us)

    def known(self, t_us: int) -> Point | None:
        """Where the ball is, if a label or a draft says so."""
        label = self.labels.get(t_us)
        if label is not None:
            return None if label.x_px is None or label.y_px is None else (label.x_px, label.y_px)
        draft = self.draft(t_us)
        return None if draft is None else (draft.x_px, draft.y_px)

    def expected(self, t_us: int) -> Point | None:
        """Where the ball is or, from the labels around, may be."""
        known = self.known(t_us)
        if known is not None:
            return known
        near = self.arrays.between(t_us - NEAR_US, t_us + NEAR_US)
        near = near.rows(near.seen)
        if not len(near):
            return None
        order = np.argsort(np.abs(near.t_us - t_us), kind="stable")[:2]
        x, y, t = near.x_px[order], near.y_px[order], near.t_us[order]
        if len(order) == 1:
            return float(x[0]), float(y[0])
        share = (t_us - t[0]) / (t[1] - t[0])
        return float(x[0] + share * (x[1] - x[0])), float(y[0] + share * (y[1] - y[0]))


@dataclass(frozen=True, slots=True)
class UnfitClick:
    """A click on a place where no circle fits: it becomes a label once a radius is given."""

    layer: Layer
    t_us: int
    x_px: float
    y_px: float
    looked_for: bool
    """Whether a circle was looked for: not on frames, and not with snapping off."""

    @property
    def question(self) -> str:
        """What the person is asked."""
        why = "no circle fits here" if self.looked_for else "how large is it?"
        return f"{why}: drag to set the radius, or press X for no ball"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Labelling:
    """The labelling of one recording. Replaced by commands, never changed."""

    recording: Recording
    sources: Mapping[str, LabelSource]
    view: LabelView
    step_us: int
    works: Mapping[str, CameraWork]
    """By camera; all of them."""
    saved: Mapping[str, Saved]
    """By camera; those whose labels have been read."""
    t_us: int = 0
    arrived_s: float = 0.0
    """When the cursor came to `t_us`; monotonic."""
    shown: PicturePlan | None = None
    """What is on the screen."""
    contacts: tuple[ContactLabel, ...] = ()
    """Bounces, hits and net touches of all cameras' layers, by time: nothing is interpolated across them."""
    proposed_contacts: tuple[ContactLabel, ...] = ()
    """Those that were found in what the detector proposes, by time."""
    recent_us: tuple[int, ...] = ()
    """The times that were labelled last, the latest at the end."""
    back_us: int = 0
    """Where a repeat annotation was begun."""
    click: UnfitClick | None = None
    """A click that is not stored, because nobody knows how large the ball is."""
    compared: LabelComparison | None = None
    """Somebody else's labels beside these."""

    @property
    def source(self) -> LabelSource:
        """The camera that is labelled."""
        return self.sources[self.view.camera]

    @property
    def others(self) -> tuple[LabelSource, ...]:
        """The cameras beside it, the next one first."""
        return others_of(self.sources, self.view.camera)

    @property
    def here(self) -> CameraWork:
        """What is known in the camera that is labelled."""
        return self.works[self.view.camera]

    @property
    def rig(self) -> dict[str, Camera]:
        """Calibrations by camera, that of the labelled one first; empty unless it and another are calibrated."""
        sources = (self.source, *self.others)
        known = {source.name: source.calibration for source in sources if source.calibration is not None}
        return known if len(known) > 1 and self.view.camera in known else {}

    @property
    def grid(self) -> Grid:
        """The times that are to be labelled."""
        return Grid(self.recording.duration_us, self.step_us, self.source.frames_us)

    @property
    def layer(self) -> Layer:
        """The layer that labels are written to."""
        return Layer(self.recording.uuid, self.view.camera, self.view.annotator, self.view.repeat)

    @property
    def on_screen(self) -> bool:
        """What the cursor points at is what the person sees: only that can be judged."""
        return self.shown is not None and self.shown.t_us == self.t_us and self.shown.main.camera == self.view.camera

    @property
    def shows_space(self) -> bool:
        """Whether events in space and time are shown; a camera with frames has none."""
        return self.view.in_space and self.source.stream is not None

    @property
    def asking(self) -> UnfitClick | None:
        """The click at the cursor that waits for its radius."""
        click = self.click
        return click if click is not None and (click.layer, click.t_us) == (self.layer, self.t_us) else None

    @property
    def compared_here(self) -> LabelComparison | None:
        """Somebody else's labels of this camera beside those of this person; not in a repeat annotation."""
        found, view = self.compared, self.view
        if found is None or view.repeat or (found.camera, found.mine.annotator) != (view.camera, view.annotator):
            return None
        return found

    def judged_picture(self, wall_s: float) -> ShownPicture:
        """The picture at the cursor as it is being judged; one without a window if it is not shown."""
        spent_ms = round(1e3 * (wall_s - self.arrived_s))
        if self.shown is None or self.shown.t_us != self.t_us:
            return ShownPicture(self.t_us, (self.t_us, self.t_us + 1), "", spent_ms)
        main = self.shown.main
        rendering = "frame" if main.frame is not None else main.rendering.replace(" ", "_")
        return ShownPicture(self.t_us, main.window_us, rendering, spent_ms)

    def picture_to_label(self, wall_s: float) -> ShownPicture:
        """The same; what is made on it by hand settles the conflict at the cursor, if there is one."""
        picture, compared = self.judged_picture(wall_s), self.compared_here
        if compared is None or not compared.differs(self.t_us):
            return picture
        theirs = compared.theirs.labels.get(self.t_us)
        return (
            picture if theirs is None else replace(picture, over=settlement(compared.theirs.annotator, theirs, "new"))
        )

    def at(self, t_us: int, wall_s: float) -> Labelling:
        """The same with the cursor at another time."""
        return self if t_us == self.t_us else replace(self, t_us=t_us, arrived_s=wall_s)


def begin_labelling(recording: Recording, view: LabelView, step_us: int, wall_s: float) -> Labelling:
    """The labelling of a recording before anything has been read, with the choices of the one before."""
    sources = sources_of(recording)
    camera = view.camera if view.camera in sources else next(iter(sources))
    return Labelling(
        recording=recording,
        sources=sources,
        view=replace(view, camera=camera, repeat=False, centre_px=None),
        step_us=step_us,
        works={name: CameraWork() for name in sources},
        saved={},
        arrived_s=wall_s,
    )
