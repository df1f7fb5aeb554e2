"""Label: place the ball on the events of one camera, exactly, fast, and so that nothing is ever lost."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from app.background.worker import LatestWins
from app.modes.label.assistant import Assistant
from app.modes.label.held_keys import HeldKeys
from app.modes.label.label_strip import StripData, strip_time
from app.modes.label.panel import LabelPanel, PanelActions
from app.modes.label.plan import LabelScene, PicturePlan, Point, agreement_at, centre_at, plan_at
from app.modes.label.prefetch import LabelMosaic, MosaicRequest, PictureCache, Prefetcher
from app.modes.label.status import (
    Checked,
    checked_of,
    here_html,
    progress_html,
    proposals_html,
    save_html,
    status_words,
)
from app.modes.label.view import DEFAULT_STEP_US, LABEL_STEPS_US, WINDOWS_US, ZOOMS, LabelView
from app.modes.label.work import LabelCallbacks, LabelWork
from app.modes.mode import Middle, ModeHost
from app.pictures.event_picture import RENDERINGS, Rendering
from app.pictures.palette import Ink
from app.state.client_state import ClientState
from app.state.commands import Seek, SetRendering, SetStep
from app.views.image_view import PANEL_SHARE, DragPhase
from core.recordings import Recording

READY_STEPS = (1, 2, 3, -1, 4, 5, 6, -2, 10, -10)
"""Neighbours that are drawn before they are asked for."""
Drawing = Callable[[], tuple[LabelWork, LabelMosaic]]


class LabelMode:
    """Label as one browser sees it."""

    uses_recording = True
    takes_keys = True
    restless = False

    def __init__(self, host: ModeHost) -> None:
        self._host = host
        self._active = False
        self._work: LabelWork | None = None
        self._assistant: Assistant | None = None
        self._recording: Recording | None = None
        self._view = LabelView()
        self._rendering: Rendering = "polarity"
        self._step_chosen = False
        self._ring: tuple[float, float, float] | None = None
        self._centre: Point | None = None
        self._keys = HeldKeys(self._carry_out, self._waits, self._place)
        self._arrival: object = None
        self._asked: object = None
        self._status: object = None
        self._counted: tuple[object, Checked] | None = None
        self._shown: LabelMosaic | None = None
        self._next: Callable[[], tuple[PicturePlan, ...]] | None = None
        """Makes what should be drawn ahead, once what is asked for is shown."""
        self._shelf = PictureCache()
        self._pictures = LatestWins(host.pool, _draw, self._drawn, self._failed)
        self._ahead = Prefetcher(host.pool, self._shelf, self._failed)
        gui = host.client.gui
        actions = PanelActions(
            act=lambda name: self._later(lambda: self._act(name)),
            change=lambda **changes: self._later(lambda: self._change(**changes)),
            name=lambda name: self._later(lambda: self._with_work(lambda work: work.call_annotator(name))),
            step=lambda step_us: host.send(SetStep(step_us)),
            numbers=lambda x, y, r: self._later(lambda: self._with_work(lambda work: work.set_numbers(x, y, r))),
        )
        self._panel = LabelPanel(gui, actions)

    @property
    def middle(self) -> Middle:
        """Label has a sheet of its own in the middle."""
        return "sheet"

    def show(self, active: bool) -> None:
        """Show the controls or hide them."""
        self._active = active
        self._keys.forget()
        self._panel.folder.visible = active
        plane = self._host.plane
        plane.panel_share = 0.0 if active else PANEL_SHARE
        plane.on_drag = self._dragged if active else None
        self._asked = self._status = None
        if active and not self._step_chosen:
            self._step_chosen = True
            self._host.send(SetStep(DEFAULT_STEP_US))
        if active:
            self._open()

    def use_recording(self, recording: Recording) -> None:
        """Another recording was opened."""
        self._drop()
        self._recording = recording
        if self._active:
            self._open()

    def tick(self, state: ClientState, now_us: int, wall_s: float) -> None:
        """Follow the time cursor; ask for the picture that belongs to it; show what is known."""
        work = self._work
        if work is None:
            return
        work.step_us = max(state.step_us, LABEL_STEPS_US[0])  # the time controls go finer than labels are counted
        work.move_to(now_us)
        self._rendering = state.look.rendering
        scene = self._scene(state)
        arrival = (work.t_us, work.view.camera, work.view.zoom, work.view.blind, work.view.follow, work.view.centre_px)
        if arrival != self._arrival:
            self._arrival = arrival
            self._ring = None
            self._centre = centre_at(scene, work.t_us, self._centre)
        assert self._centre is not None
        plan = plan_at(scene, work.t_us, self._centre)
        words = status_words(work, self._checked(work), agreement_at(scene, work.t_us))
        known = (plan, work.here.arrays, work.here.proposals, work.breaks_us, work.step_us, words)
        if known != self._asked:
            self._asked = known
            self._ask(scene, plan, words)
        self._show_status(scene)
        if self._keys.ready:
            self._later(self._keys.go_on)

    def clicked(self, x: float, y: float) -> None:
        """The ball is here; or, in the strip or the overview, look there."""
        if self._shown is None or self._work is None:
            return
        point = self._shown.main.sensor_point(x, y)
        strip = self._shown.strip
        if point is not None:
            self._work.click(*point)
        elif strip.sensor_point(x, y) is not None:
            share = (x - strip.x) / strip.width
            self._work.go(strip_time(0, self._work.recording.duration_us, share))
        elif (point := self._shown.overview.sensor_point(x, y)) is not None:
            self._work.change_view(centre_px=point, zoom=self._work.view.zoom if self._work.view.zoom > 1 else ZOOMS[1])
            self._centre, self._arrival = point, None

    def close(self) -> None:
        """The browser is gone."""
        self._pictures.close()
        self._ahead.close()
        self._drop()

    # Pictures -----------------------------------------------------------------------------------------------------

    def _scene(self, state: ClientState) -> LabelScene:
        work = self._work
        assert work is not None
        partner = work.partner
        there = work.works[partner.name] if partner is not None else work.here
        return LabelScene(
            work.source, partner, work.view, state.look.rendering, state.look.colours, work.here, there, self._ring
        )

    def _ask(self, scene: LabelScene, plan: PicturePlan, words: tuple[tuple[str, Ink], ...]) -> None:
        """Draw what is to be seen now, then its neighbours."""
        work, centre = self._work, self._centre
        assert work is not None and centre is not None
        arrays, proposals = work.here.arrays, work.here.proposals
        proposed = proposals.t_us if proposals is not None else arrays.t_us[:0]
        strip = StripData(0, work.recording.duration_us, arrays.t_us, arrays.state, proposed, work.breaks_us, words)
        request = MosaicRequest(plan, work.sources, strip, work.step_us)
        self._ahead.pause()  # what is asked for now comes first
        self._pictures.submit(lambda: (work, self._shelf.make_sheet(request)))
        grid = work.grid
        self._next = None if scene.ring else lambda: _neighbours(scene, grid.moved, plan.t_us, centre)

    def _drawn(self, ask: Drawing, answer: tuple[LabelWork, LabelMosaic]) -> None:
        self._later(lambda: self._show_sheet(*answer))

    def _show_sheet(self, work: LabelWork, sheet: LabelMosaic) -> None:
        if self._active and work is self._work:
            self._shown = sheet
            work.shown = sheet.plan
            self._host.plane.show(sheet.sheet)
            if self._next is not None:
                self._ahead.want(self._next, work.sources)
                self._next = None

    def _dragged(self, phase: DragPhase, start: Point, end: Point) -> None:
        self._later(lambda: self._drag(phase, start, end))

    def _drag(self, phase: DragPhase, start: Point, end: Point) -> None:
        """From the centre to the rim."""
        work, shown = self._work, self._shown
        if work is None or shown is None or not self._active:
            return
        centre, rim = shown.main.sensor_point(*start), shown.main.sensor_point(*end)
        if centre is None or rim is None:
            self._ring = None
            return
        radius = math.dist(centre, rim)
        if phase == "end":
            self._ring = None
            work.draw_circle(*centre, radius)
        else:
            self._ring = (*centre, radius)

    # What a person asks for ---------------------------------------------------------------------------------------

    def _act(self, name: str) -> None:
        if self._work is not None and self._active:
            self._keys.press(name)

    def _waits(self, name: str) -> bool:
        """Whether what this act judges is still to come."""
        return name == "accept_segment" and self._assistant is not None and not self._assistant.segment_due

    def _place(self) -> object:
        work = self._work
        return None if work is None else (work.layer, work.t_us)

    def _carry_out(self, name: str) -> None:
        work, assistant, state = self._work, self._assistant, self._host.state
        if work is None or assistant is None or state is None or not self._active:
            return
        kind, _, number = name.partition("_")
        if kind == "window" and number.isdigit():
            work.change_view(window_us=WINDOWS_US[int(number)])
        elif kind == "zoom" and number.isdigit():
            work.change_view(zoom=ZOOMS[int(number)])
        elif not work.perform(name):
            acts: dict[str, Callable[[], None]] = {
                "accept_segment": assistant.accept_segment,
                "interpolate": assistant.interpolate,
                "propose": lambda: assistant.toggle_propose(state.config),
                "suspicious": assistant.next_suspicious,
                "blind": assistant.second_look,
                "escape": assistant.leave_second_look,
                "camera": lambda: self._change(camera=_next_name(tuple(work.sources), work.view.camera)),
                "rendering": lambda: self._host.send(SetRendering(_next_name(RENDERINGS, state.look.rendering))),
            }
            acts[name]()

    def _change(self, **changes: object) -> None:
        self._with_work(lambda work: work.change_view(**changes))

    def _with_work(self, act: Callable[[LabelWork], None]) -> None:
        if self._work is not None and self._active:
            self._status = None
            act(self._work)

    def _later(self, act: Callable[[], None]) -> None:
        self._host.later(act)

    def _failed(self, error: Exception) -> None:
        self._later(self._keys.forget)  # no picture: what waits for it would wait for ever
        self._later(lambda: self._host.report(error))

    # What is shown ------------------------------------------------------------------------------------------------

    def _show_status(self, scene: LabelScene) -> None:
        work, assistant = self._work, self._assistant
        assert work is not None and assistant is not None
        self._panel.show_save(save_html(work))
        proposals = proposals_html(work.here.proposals, assistant.share, len(self._keys) > 0)
        self._panel.show_proposals(proposals, assistant.share is not None)
        known = (work.t_us, work.view, work.step_us, scene.here, scene.there, assistant.reason_us)
        if known == self._status:
            return
        self._status = known
        label = None if work.view.blind else work.here.labels.get(work.t_us)
        with self._host.client.atomic():
            self._panel.show_view(work.view, work.step_us)
            self._panel.show_label(label)
            self._panel.show_progress(progress_html(self._checked(work)))
            reason = assistant.reason if assistant.reason_us == work.t_us else ""
            drafted = scene.here.draft(work.t_us) is not None
            agreement = agreement_at(scene, work.t_us)
            self._panel.show_here(here_html(label, drafted, agreement, reason, work.view.blind))

    def _checked(self, work: LabelWork) -> Checked:
        """Counted anew when a label or the step changed."""
        counted = (work.here.arrays, work.step_us, work.view.camera)
        if self._counted is None or self._counted[0] != counted:
            self._counted = (counted, checked_of(work))
        return self._counted[1]

    def _open(self) -> None:
        if self._work is not None or self._recording is None:
            return
        host, state = self._host, self._host.state
        hooks = LabelCallbacks(host.later, host.report, host.note, lambda t_us: host.send(Seek(t_us)))
        step_us = DEFAULT_STEP_US if state is None else state.step_us
        self._work = LabelWork(host.services.label_stores, self._recording, hooks, self._view, step_us)
        self._assistant = Assistant(self._work, host.pool)
        self._panel.offer_cameras(tuple(self._work.sources))
        self._shelf = PictureCache()
        self._ahead.close()
        self._ahead = Prefetcher(host.pool, self._shelf, self._failed)
        self._centre = self._arrival = self._asked = self._status = self._shown = None

    def _drop(self) -> None:
        self._keys.forget()
        if self._assistant is not None:
            self._assistant.close()
        if self._work is not None:
            self._view = replace(self._work.view, blind=False)
            self._work.close()
        self._work = self._assistant = None


def _draw(ask: Drawing) -> tuple[LabelWork, LabelMosaic]:
    return ask()


def _neighbours(
    scene: LabelScene, moved: Callable[[int, int], int], t_us: int, centre: Point
) -> tuple[PicturePlan, ...]:
    """What the next steps will show, the likeliest first."""
    plans = []
    for steps in READY_STEPS:
        at_us = moved(t_us, steps)
        plans.append(plan_at(scene, at_us, centre_at(scene, at_us, centre)))
    return tuple(plans)


def _next_name(names: tuple, name: str):
    return names[(names.index(name) + 1) % len(names)]
