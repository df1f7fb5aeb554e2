"""What one browser labels, as one frozen value: cursor, choices, and what is known of the ball in each camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from app.modes.label.label_changes import ProposedLabel, ShownPicture
from app.modes.label.label_writer import LayerKey, Saved
from app.modes.label.merge.comparison import LabelComparison
from app.modes.label.plan import CameraWork, PicturePlan
from app.modes.label.sources import LabelSource, partner_of, sources_of
from app.modes.label.view import Grid, LabelView
from core.cameras import Camera
from core.recordings import Recording
from labels.conflicts import settlement


@dataclass(frozen=True, slots=True)
class UnfitClick:
    """A click on a place where no circle fits: it becomes a label once a radius is given."""

    layer: LayerKey
    t_us: int
    x_px: float
    y_px: float
    looked_for: bool
    """Whether a circle was looked for: not on frames, and not with snapping off."""

    @property
    def question(self) -> str:
        """What the person is asked."""
        why = "no circle fits here" if self.looked_for else "how large is it?"
        return f"{why}: drag to set the radius, or press X for absent"


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
    breaks_us: tuple[int, ...] = ()
    """Bounces and hits: nothing is interpolated across them."""
    recent_us: tuple[int, ...] = ()
    """The times that were labelled last, the latest at the end."""
    back_us: int = 0
    """Where a second look was begun."""
    click: UnfitClick | None = None
    """A click that is not stored, because nobody knows how large the ball is."""
    compared: LabelComparison | None = None
    """Somebody else's labels beside these."""

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
    def there(self) -> CameraWork | None:
        """What is known in its partner."""
        return None if self.partner is None else self.works[self.partner.name]

    @property
    def calibrations(self) -> tuple[Camera, Camera] | None:
        """Of the camera that is labelled and of its partner; None unless both are known."""
        partner = self.partner
        if partner is None or self.source.calibration is None or partner.calibration is None:
            return None
        return self.source.calibration, partner.calibration

    @property
    def grid(self) -> Grid:
        """The times that are to be labelled."""
        return Grid(self.recording.duration_us, self.step_us, self.source.frames_us)

    @property
    def layer(self) -> LayerKey:
        """The layer that labels are written to."""
        return LayerKey(self.view.camera, self.view.annotator, self.view.blind)

    @property
    def on_screen(self) -> bool:
        """What the cursor points at is what the person sees: only that can be judged."""
        return self.shown is not None and self.shown.t_us == self.t_us and self.shown.main.camera == self.view.camera

    @property
    def asking(self) -> UnfitClick | None:
        """The click at the cursor that waits for its radius."""
        click = self.click
        return click if click is not None and (click.layer, click.t_us) == (self.layer, self.t_us) else None

    @property
    def compared_here(self) -> LabelComparison | None:
        """Somebody else's labels of this camera beside those of this person; not in a second look, which is blind."""
        found, view = self.compared, self.view
        if found is None or view.blind or (found.camera, found.mine.annotator) != (view.camera, view.annotator):
            return None
        return found

    def draft(self, t_us: int) -> ProposedLabel | None:
        """What is proposed at a time and may be seen."""
        return None if self.view.blind else self.here.draft(t_us)

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

    def moved(self, steps: int, wall_s: float) -> Labelling:
        """The same with the cursor so many times on or back that are to be labelled."""
        return self.at(self.grid.moved(self.t_us, steps), wall_s)


def begin_labelling(recording: Recording, view: LabelView, step_us: int, wall_s: float) -> Labelling:
    """The labelling of a recording before anything has been read, with the choices of the one before."""
    sources = sources_of(recording)
    camera = view.camera if view.camera in sources else next(iter(sources))
    return Labelling(
        recording=recording,
        sources=sources,
        view=replace(view, camera=camera, blind=False, centre_px=None),
        step_us=step_us,
        works={name: CameraWork() for name in sources},
        saved={},
        arrived_s=wall_s,
    )
