"""Label: place the ball on the events of one camera, exactly, fast, and so that nothing is ever lost."""

from __future__ import annotations

import math
import time
import uuid
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from app.modes.label.annotator import AnnotatorPrompt, annotator_from, last_annotator, remember_annotator
from app.modes.label.ball_search import NOT_FOUND, BallRequest, BallSearch
from app.modes.label.comparer import LabelComparer, OtherStores
from app.modes.label.contacts_panel import ContactsPanel
from app.modes.label.editor import EditorAct, LabelCallbacks, LabelEditor, Note
from app.modes.label.import_panel import LabelImports
from app.modes.label.kept_view import KeptView
from app.modes.label.keys import ACTS, HeldKeys, idle_key_text
from app.modes.label.label_picture import strip_time
from app.modes.label.labelling import (
    DEFAULT_STEP_US,
    LABEL_STEPS_US,
    ZOOMS,
    Labelling,
    LabelView,
    Point,
    begin_labelling,
)
from app.modes.label.merge_panel import MergePanel
from app.modes.label.panel import LabelPanel, PanelActions
from app.modes.label.pictures import LabelMosaic, LabelPictures
from app.modes.label.plan import LabelScene
from app.modes.label.results import LabelResults
from app.modes.label.sightings import CameraAgreement, agreement_at, draft_at, expected_at
from app.modes.label.space import LabelSpaceView
from app.modes.label.status import (
    Checked,
    checked_of,
    here_html,
    live_html,
    live_words,
    progress_html,
    proposals_html,
    save_html,
    status_words,
)
from app.modes.label.suggestions import LabelSuggestions
from app.modes.live_copy import LiveCopy
from app.modes.mode import Middle, ModeHost
from app.panels.time_bar import runs_of_times
from app.pictures.canvas import RENDERINGS
from app.pictures.palette import PaletteIndex
from app.state.client_state import ClientState, PickedPoint
from app.state.commands import PickCluster, Seek, SetRendering, SetStep, SignIn
from app.views.image_view import DragPhase
from core.errors import CommandError
from core.live.ring_recording import RingRecording
from core.recordings import Recording
from labels.arrays import STATES, LabelArrays
from labels.assist import load_snap

IN_BAR_EVERY_S: Final = 0.5
JUST_NOW: Final = -1
"""In place of the time at which Label was entered, until the first turn of the loop there."""


class LabelMode:
    """Label as one browser sees it."""

    uses_recording = True
    takes_keys = True
    needs_tick = False

    def __init__(self, host: ModeHost) -> None:
        self._host = host
        self._active = False
        self._editor: LabelEditor | None = None
        self._suggestions: LabelSuggestions | None = None
        self._comparer: LabelComparer | None = None
        self._kept = KeptView(host.send)
        self._other_stores = OtherStores(host.services.workspace.root, host.services.library.folders)
        self._recording: Recording | None = None
        self._view = LabelView()
        """The choices that the next recording begins with."""
        self._session = uuid.uuid4().hex
        """Under which what this browser does is kept: it takes back nothing else."""
        self._answered = False
        """Whether the act that is done has written, noted or reported something."""
        self._named = False
        """Whether the person has said who labels."""
        self._prompt: AnnotatorPrompt | None = None
        self._live = LiveCopy(host)
        self._step_chosen = False
        self._entry_us: int | None = None
        """Where Label was entered, until the labels of the camera are read."""
        self._elsewhere = ("", 0)
        """The camera that the other modes look at, and how often it was handed over, as Label last followed it."""
        self._ring: tuple[float, float, float] | None = None
        self._looks = False
        """Whether a person has chosen the middle of the zoomed picture since the last turn of the loop."""
        self._in_bar: LabelArrays | None = None
        self._in_bar_s = 0.0
        self._keys = HeldKeys(self._carry_out, self._waits, self._place)
        self._status: object = None
        self._counted: tuple[object, Checked] | None = None
        self._agreed: tuple[object, CameraAgreement | None] | None = None
        self._pictures = LabelPictures(
            host.pool,
            lambda request, editor, mosaic: host.later(lambda: self._show_mosaic(request, editor, mosaic)),
            self._picture_failed,
            host.plane.freshness,
        )
        self._space = LabelSpaceView(host, lambda shown: self._panel.show_space_note(shown.note), self._picture_failed)
        self._was_in_space = False
        self._search = BallSearch(host.pool, host.later, self._ball_found, self._failed)
        actions = PanelActions(
            act=lambda name: host.later(lambda: self._act(name)),
            change=lambda **changes: host.later(lambda: self._do(lambda editor: editor.change_view(changes))),
            name=lambda name: host.later(lambda: self._use_name(name)),
            step=lambda step_us: host.send(SetStep(step_us)),
            numbers=lambda x, y, r: host.later(lambda: self._do(lambda editor: editor.set_numbers(x, y, r))),
        )
        self._panel = LabelPanel(host.client.gui, actions)
        host.listen("field", lambda message: self._panel.field_left(message.get("name"), message.get("text")))
        with self._panel.folder:
            self._contacts = ContactsPanel(host, actions.act)
            self._merge = MergePanel(
                host.client.gui,
                lambda title: host.later(lambda: None if self._comparer is None else self._comparer.choose(title)),
                lambda name: host.later(lambda: self._act(name)),
            )
            self._results = LabelResults(host)
            self._imports = LabelImports(host)

    @property
    def middle(self) -> Middle:
        """Label has a sheet of its own in the middle, or the events round the cursor in space and time."""
        return "space" if self._editor is not None and self._editor.labelling.shows_space else "sheet"

    @property
    def labelling(self) -> Labelling | None:
        """What is labelled in the open recording; None before Label was entered."""
        return None if self._editor is None else self._editor.labelling

    @property
    def is_saved(self) -> bool:
        """Whether every change is on the disk."""
        return self._editor is not None and self._editor.writer.failure is None and not self._editor.writer.waiting

    def show(self, active: bool) -> None:
        """Show the controls or hide them."""
        self._active = active
        self._keys.forget()
        if active:
            self._panel.show_name(self._name())  # before a person sees the field: later it would replace what is typed
        self._panel.folder.visible = active
        self._panel.listen_to_keys(active)
        plane = self._host.plane
        plane.with_panel = not active
        plane.on_drag = self._dragged if active else None
        self._host.space.on_pick = (lambda point: self._host.later(lambda: self._pick(point))) if active else None
        self._status = None
        self._pictures.ask_again()
        self._space.forget()
        if not active:
            self._live.forget()
        if active and not self._step_chosen:
            self._step_chosen = True
            self._host.send(SetStep(DEFAULT_STEP_US))
        self._entry_us = JUST_NOW if active else None
        if active:
            self._open()

    def use_recording(self, recording: Recording) -> None:
        """Another recording was opened."""
        self._drop()
        self._kept.forget()
        self._recording, self._in_bar = recording, None
        self._contacts.forget()
        if self._host.state is not None:
            self._elsewhere = (self._host.state.camera, self._host.state.looks)
        if self._active:
            self._open()
            moment_us = self._live.moment_in(recording)
            if moment_us is not None:
                self._host.send(Seek(moment_us))

    def tick(self, state: ClientState, now_us: int, wall_s: float) -> None:
        """Follow the time cursor; ask for the picture that belongs to it; show what is known."""
        editor, comparer = self._editor, self._comparer
        if editor is None or comparer is None:
            return
        editor.follow(now_us, max(state.step_us, LABEL_STEPS_US[0]))  # the time controls go finer than labels do
        self._enter(editor, state, now_us)
        editor.look_again(wall_s)
        if (state.camera, state.looks) != self._elsewhere:  # another was chosen in Tune, or one is named by Watch
            self._elsewhere = (state.camera, state.looks)
            editor.change_view({"camera": state.camera})
        self._results.tick(editor, state, wall_s)
        self._imports.tick(editor, wall_s)
        self._kept.follow(state, editor, comparer)
        comparer.tick(wall_s)
        now = editor.labelling
        scene = self._scene(editor, state)
        if self._pictures.arrives(scene, now.t_us):
            self._ring, scene = None, replace(scene, ring=None)
            self._search.want(None if self._looks else self._ball_request(now, state))
            self._looks = False
        share = None if self._suggestions is None else self._suggestions.share
        words = status_words(now, editor.writer, self._checked(editor), self._agreement(now), share)
        if self._search.is_missing:
            words = (*words, (NOT_FOUND, PaletteIndex.NO_BALL))
        if isinstance(self._recording, RingRecording):
            words = live_words(self._live.share)
        if now.shows_space != self._was_in_space:
            self._was_in_space = now.shows_space
            self._pictures.ask_again()
            self._space.forget()
        if now.shows_space:
            self._space.ask(scene, self._pictures.centre, wall_s)
        else:
            self._pictures.ask(editor, scene, words, wall_s)
        self._show_in_time_bar(editor, wall_s)
        self._show_status(editor)
        self._contacts.show(now)
        self._merge.show(comparer, now)
        if self._keys.ready:
            self._host.later(self._keys.go_on)

    def _enter(self, editor: LabelEditor, state: ClientState, now_us: int) -> None:
        """Begin at a time that counts as progress; not where a person plays, or has gone on since."""
        if self._entry_us == JUST_NOW:
            self._entry_us = now_us
        if self._entry_us is None or editor.labelling.view.camera not in editor.labelling.saved:
            return
        stays = now_us == self._entry_us and not state.playhead.playing
        self._entry_us = None
        if stays and not isinstance(self._recording, RingRecording):
            editor.do(LabelEditor.enter)

    def clicked(self, x: float, y: float) -> None:
        """The ball is here; in the strip or the overview: look there; in another camera's picture: label that."""
        shown, editor = self._pictures.shown, self._editor
        if shown is None or editor is None:
            return
        if (point := shown.main.sensor_point(x, y)) is not None:
            editor.do(lambda editor: editor.place_ball(*point))
        elif shown.strip.sensor_point(x, y) is not None:
            share = (x - shown.strip.x) / shown.strip.width
            editor.go_to(strip_time(0, editor.labelling.recording.duration_us, share))
        elif (point := shown.overview.sensor_point(x, y)) is not None:
            self._look_at(editor, point)
        else:
            for camera, tile in shown.others:
                if tile.sensor_point(x, y) is not None:
                    editor.change_view({"camera": camera})

    def _look_at(self, editor: LabelEditor, point: Point) -> None:
        editor.change_view({"centre_px": point, "zoom": max(editor.labelling.view.zoom, ZOOMS[1])})
        self._pictures.look_at(point)
        self._looks = True

    def _pick(self, point: Point) -> None:
        """An event in space was clicked: look there, and choose its cluster in Tune, too."""
        if self._editor is not None and self._active:
            now = self._editor.labelling
            self._host.send(PickCluster(PickedPoint(now.view.camera, now.t_us, point)))
            self._look_at(self._editor, point)

    def close(self) -> None:
        """The browser is gone."""
        self._pictures.close()
        self._space.close()
        self._search.close()
        self._live.close()
        self._imports.close()
        self._drop()

    def _ball_request(self, now: Labelling, state: ClientState) -> BallRequest | None:
        """What to search where the zoomed picture is to follow a ball of which nothing is known."""
        view, stream = now.view, now.source.stream
        follows = view.follow and view.zoom > 1.0 and not view.repeat
        if not follows or stream is None or expected_at(now, now.t_us, view.camera) is not None:
            return None
        return BallRequest(stream, now.t_us, state.detector)

    def _ball_found(self, point: Point) -> None:
        """The zoomed picture goes there, but not away under a hand that draws a circle in it."""
        if self._ring is None:
            self._pictures.move_to(point)

    def _show_in_time_bar(self, editor: LabelEditor, wall_s: float) -> None:
        """The labels of the camera by state; in a second look only those of the second look."""
        arrays = editor.labelling.here.arrays
        if arrays is not self._in_bar and wall_s - self._in_bar_s >= IN_BAR_EVERY_S:
            self._in_bar, self._in_bar_s = arrays, wall_s
            states = arrays.state.astype(np.int64)
            self._host.show_runs("labels", runs_of_times(arrays.t_us, states, tuple(STATES), editor.labelling.step_us))

    # Pictures -----------------------------------------------------------------------------------------------------

    def _scene(self, editor: LabelEditor, state: ClientState) -> LabelScene:
        aspect = self._host.plane.free_aspect
        return LabelScene(editor.labelling, state.look.rendering, state.look.colours, self._ring, aspect)

    def _show_mosaic(self, request: object, editor: LabelEditor, mosaic: LabelMosaic) -> None:
        if self._active and editor is self._editor:
            editor.show(mosaic.plan)
            self._host.plane.show(mosaic.sheet, request)
            self._pictures.show(mosaic)
            self._live.shown(editor.labelling.recording, mosaic.plan.t_us)

    def _dragged(self, phase: DragPhase, start: Point, end: Point) -> None:
        self._host.later(lambda: self._drag(phase, start, end))

    def _drag(self, phase: DragPhase, start: Point, end: Point) -> None:
        """From the centre to the rim."""
        shown = self._pictures.shown
        if self._editor is None or shown is None or not self._active:
            return
        centre, rim = shown.main.sensor_point(*start), shown.main.sensor_point(*end)
        self._ring = None
        if centre is None or rim is None:
            return
        r_px = math.dist(centre, rim)
        if phase == "end":
            self._editor.do(lambda editor: editor.place_ball(*centre, r_px))
        else:
            self._ring = (*centre, r_px)

    # What a person asks for ---------------------------------------------------------------------------------------

    def _act(self, name: str) -> None:
        if self._editor is not None and self._active:
            self._keys.press(name)

    def _waits(self, name: str) -> bool:
        """Whether what this act judges is still to come."""
        return (
            name in ("accept_segment", "accept_flight")
            and self.middle == "sheet"  # in space and time no picture comes on which it could be judged
            and self._suggestions is not None
            and not self._suggestions.segment_due
        )

    def _place(self) -> object:
        editor = self._editor
        return None if editor is None else (editor.labelling.layer, editor.labelling.t_us)

    def _carry_out(self, name: str) -> None:
        suggestions, state = self._suggestions, self._host.state
        if name in ACTS:
            self._do_act(name)
        elif name in ("propose", "suspicious", "blind") and isinstance(self._recording, RingRecording):
            self._freeze(self._recording, lambda: self._carry_out(name))
        elif suggestions is not None and state is not None and self._active:
            acts: dict[str, Callable[[], None]] = {
                "propose": lambda: suggestions.toggle_propose(state.detector),
                "suspicious": suggestions.next_suspicious,
                "blind": suggestions.repeat_annotation,
                "accept_flight": suggestions.take_flight,
                "rendering": lambda: self._host.send(SetRendering(_next_name(RENDERINGS, state.look.rendering))),
            }
            acts[name]()

    def _do_act(self, name: str) -> None:
        """Do what a key or button stands for; say so if it changed nothing."""
        before, self._answered = self._at_hand(), False
        self._do(ACTS[name])
        if not self._answered and self._at_hand() == before:
            self._host.say(idle_key_text(name))

    def _at_hand(self) -> object:
        """All that an act can change at once: what it writes is saved later."""
        if self._editor is None:
            return None
        now = self._editor.labelling
        return now.t_us, now.view, now.works, now.contacts, now.asking

    def _note(self, note: Note) -> None:
        self._answered = True
        self._host.note(note.title, note.text, note.colour)

    def _report(self, error: Exception) -> None:
        self._answered = True
        self._host.report(error)

    def _do(self, act: EditorAct) -> None:
        if self._editor is not None and self._active:
            self._status = None
            self._editor.do(act)

    def _use_name(self, text: str) -> None:
        try:
            name = annotator_from(text)
        except CommandError:
            self._panel.show_name()
            raise
        self._sign_in(name)

    def _sign_in(self, name: str) -> None:
        """From now on this browser's labels are of this annotator."""
        self._named = True
        self._host.send(SignIn(name))
        self._panel.show_name(name)  # as it is stored: small letters
        self._do(lambda editor: editor.change_view({"annotator": name}))

    def _may_write(self, act: EditorAct) -> bool:
        """Labels belong to somebody, and to a recording that stays; else first things first."""
        assert self._editor is not None
        self._answered = True
        if isinstance(self._recording, RingRecording):
            self._freeze(self._recording, lambda: self._do(act))
            return False
        if not self._named:
            self._ask_name(act)
            return False
        remember_annotator(self._host.services.workspace.labels, self._editor.labelling.view.annotator)
        return True

    def _ask_name(self, act: EditorAct) -> None:
        if self._prompt is not None or self._editor is None:
            return
        host, editor = self._host, self._editor

        def named(name: str) -> None:
            self._prompt = None
            self._sign_in(name)
            if editor is self._editor:
                self._do(act)

        def declined() -> None:
            self._prompt = None

        self._prompt = AnnotatorPrompt(
            host.client.gui,
            editor.labelling.view.annotator,
            lambda name: host.later(lambda: named(name)),
            lambda: host.later(declined),
        )

    def _freeze(self, recording: RingRecording, then: Callable[[], None]) -> None:
        assert self._editor is not None
        now = self._editor.labelling
        t_us = now.t_us if now.shown is None else now.shown.t_us
        self._live.begin(recording, t_us, now.step_us, then)

    def _picture_failed(self, error: Exception) -> None:
        self._host.later(self._host.plane.freshness.failed)
        self._failed(error)

    def _failed(self, error: Exception) -> None:
        self._host.later(self._keys.forget)  # no picture: what waits for it would wait for ever
        self._host.later(lambda: self._host.report(error))

    # What is shown ------------------------------------------------------------------------------------------------

    def _show_status(self, editor: LabelEditor) -> None:
        now, suggestions = editor.labelling, self._suggestions
        assert suggestions is not None
        live = isinstance(self._recording, RingRecording)
        self._panel.show_save(live_html(self._live.share) if live else save_html(now, editor.writer))
        proposals = proposals_html(
            now.here.proposals, suggestions.share, len(self._keys) > 0, lost=self._kept.lacks_proposals
        )
        self._panel.show_proposals(proposals, suggestions.share is not None)
        label = None if now.view.repeat else now.here.labels.get(now.t_us)
        reason = suggestions.reason_for(label)
        saved = now.saved.get(now.view.camera)
        known = (now.t_us, now.view, now.step_us, now.works, reason, now.asking, saved)
        if known == self._status:
            return
        self._status = known
        with self._host.client.atomic():
            self._panel.show_view(now.view, now.step_us)
            self._panel.show_label(label, now.asking)
            known_of = None if now.view.repeat else saved  # what a second look wrote is in a layer of its own
            can_undo, can_redo = (True, True) if known_of is None else (known_of.can_undo, known_of.can_redo)
            self._panel.show_undo(can_undo=can_undo, can_redo=can_redo)
            self._panel.show_progress("" if live else progress_html(self._checked(editor)))
            draft = draft_at(now, now.t_us)
            self._panel.show_here(here_html(label, draft, self._agreement(now), reason, now))

    def _agreement(self, now: Labelling) -> CameraAgreement | None:
        """Worked out anew when the cursor or what is known of the ball has changed, not at every turn of the loop."""
        key = (now.t_us, now.view, now.works)
        if self._agreed is None or self._agreed[0] != key:
            self._agreed = (key, agreement_at(now, now.t_us))
        return self._agreed[1]

    def _checked(self, editor: LabelEditor) -> Checked:
        """Counted anew when a label or the step changed."""
        now = editor.labelling
        counted = (now.here.arrays, now.step_us, now.view.camera)
        if self._counted is None or self._counted[0] != counted:
            self._counted = (counted, checked_of(now))
        return self._counted[1]

    def _name(self) -> str:
        """The name that the field shows: of whoever labels here, or labelled last in this workspace."""
        if self._editor is not None:
            return self._editor.labelling.view.annotator
        return self._view.annotator if self._named else last_annotator(self._host.services.workspace.labels)

    def _open(self) -> None:
        if self._editor is not None or self._recording is None:
            return
        host, state = self._host, self._host.state
        callbacks = LabelCallbacks(
            self._may_write,
            host.later,
            self._report,
            self._note,
            lambda t_us: host.send(Seek(t_us)),
        )
        step_us = DEFAULT_STEP_US if state is None else state.step_us
        self._view = replace(self._view, annotator=self._name())
        labelling = begin_labelling(self._recording, self._view, step_us, time.monotonic())
        host.pool.submit(load_snap)
        self._editor = LabelEditor(host.services.label_stores, labelling, callbacks, self._session)
        self._suggestions = LabelSuggestions(self._editor, host.pool)
        self._comparer = LabelComparer(self._editor, host.services.workspace.labels, self._other_stores, host.pool)
        self._panel.offer_cameras(tuple(labelling.sources))
        self._pictures.begin()
        self._status = None

    def _drop(self) -> None:
        self._keys.forget()
        if self._suggestions is not None:
            self._suggestions.close()
        if self._comparer is not None:
            self._comparer.close()
        if self._editor is not None:
            self._view = replace(self._editor.labelling.view, repeat=False)
            self._editor.close()
        self._editor = self._suggestions = self._comparer = None


def _next_name(names: tuple, name: str):
    return names[(names.index(name) + 1) % len(names)]
