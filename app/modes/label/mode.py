"""Label: place the ball on the events of one camera, exactly, fast, and so that nothing is ever lost."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from app.modes.label.annotator import AnnotatorSignIn, last_annotator, remember_annotator
from app.modes.label.ball_search import NOT_FOUND, BallRequest, BallSearch
from app.modes.label.by_hand import set_numbers
from app.modes.label.comparer import LabelComparer, OtherStores
from app.modes.label.contacts_panel import ContactsPanel
from app.modes.label.editor import EditorAct, LabelCallbacks, LabelEditor, Note
from app.modes.label.import_panel import LabelImports
from app.modes.label.kept_view import KeptView
from app.modes.label.keys import ACTS, JUDGES, HeldKeys, idle_key_text
from app.modes.label.labelling import DEFAULT_STEP_US, LABEL_STEPS_US, Labelling, LabelView, Point, begin_labelling
from app.modes.label.merge_panel import MergePanel
from app.modes.label.panel import LabelPanel, PanelActions
from app.modes.label.pictures import LabelMosaic, LabelPictures
from app.modes.label.plan import LabelScene
from app.modes.label.pointer import LabelPointer
from app.modes.label.results import LabelResults
from app.modes.label.sightings import expected_at
from app.modes.label.space import LabelSpaceView
from app.modes.label.status import live_html, live_words, status_words
from app.modes.label.status_display import StatusDisplay
from app.modes.label.suggestions import LabelSuggestions
from app.modes.live_copy import LiveCopy
from app.modes.mode import Middle, ModeHost
from app.pictures.canvas import RENDERINGS
from app.pictures.palette import PaletteIndex
from app.state.client_state import ClientState, PickedPoint
from app.state.commands import PickCluster, Seek, SetRendering, SetStep
from app.views.image_view import DragPhase
from core.live.ring_recording import RingRecording
from core.recordings import Recording
from labels.assist import load_snap
from labels.balls.to_label import read_moments

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
        self._live = LiveCopy(host)
        self._step_chosen = False
        self._entry_us: int | None = None
        """Where Label was entered, until the labels of the camera are read."""
        self._elsewhere = ("", 0)
        """The camera that the other modes look at, and how often it was handed over, as Label last followed it."""
        self._keys = HeldKeys(self._carry_out, self._waits, self._place)
        self._pictures = LabelPictures(
            host.pool,
            lambda request, editor, mosaic: host.later(lambda: self._show_mosaic(request, editor, mosaic)),
            self._picture_failed,
            host.plane.freshness,
        )
        self._pointer = LabelPointer(self._pictures)
        self._space = LabelSpaceView(host, lambda shown: self._panel.show_space_note(shown.note), self._picture_failed)
        self._was_in_space = False
        self._search = BallSearch(host.pool, host.later, self._ball_found, self._failed)
        actions = PanelActions(
            act=lambda name: host.later(lambda: self._act(name)),
            change=lambda **changes: host.later(lambda: self._do(lambda editor: editor.change_view(changes))),
            name=lambda name: host.later(lambda: self._use_name(name)),
            step=lambda step_us: host.send(SetStep(step_us)),
            numbers=lambda x, y, r: host.later(lambda: self._do(lambda editor: set_numbers(editor, x, y, r))),
        )
        self._panel = LabelPanel(host.client.gui, actions)
        self._display = StatusDisplay(host, self._panel)
        self._sign_in = AnnotatorSignIn(host, self._panel.show_name, self._name_layer)
        host.listen("field", lambda message: self._panel.field_left(message.get("name"), message.get("text")))
        with self._panel.contacts:
            self._contacts = ContactsPanel(host, actions.act)
        with self._panel.folder:
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
        self._display.forget()
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
        self._recording = recording
        self._display.forget_time_bar()
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
        editor, comparer, suggestions = self._editor, self._comparer, self._suggestions
        if editor is None or comparer is None or suggestions is None:
            return
        self._follow(editor, state, now_us)
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
            self._pointer.ring, scene = None, replace(scene, ring=None)
            self._search.want(None if self._pointer.looks else self._ball_request(now, state))
            self._pointer.looks = False
        checked, agreement = self._display.checked(now), self._display.agreement(now)
        words = status_words(now, editor.writer, checked, agreement, suggestions.share)
        if self._search.is_missing:
            words = (*words, (NOT_FOUND, PaletteIndex.NO_BALL))
        live = ""
        if isinstance(self._recording, RingRecording):
            words, live = live_words(self._live.share), live_html(self._live.share)
        if now.shows_space != self._was_in_space:
            self._was_in_space = now.shows_space
            self._pictures.ask_again()
            self._space.forget()
        if now.shows_space:
            self._space.ask(scene, self._pictures.centre, state, wall_s)
        else:
            self._pictures.ask(editor, scene, words, wall_s)
        self._display.show_in_time_bar(now, wall_s)
        self._display.show(editor, suggestions, live, len(self._keys) > 0, lacks_proposals=self._kept.lacks_proposals)
        self._contacts.show(now)
        self._merge.show(comparer, now)
        if self._keys.ready:
            self._host.later(self._keys.go_on)

    def _follow(self, editor: LabelEditor, state: ClientState, now_us: int) -> None:
        editor.follow(now_us, max(state.step_us, LABEL_STEPS_US[0]))  # the time controls go finer than labels do

    def _catch_up(self) -> None:
        """Stand where the time controls stand: a key can come in the same turn of the loop as the time before it."""
        state = self._host.state
        if self._editor is not None and state is not None and not state.playhead.playing:
            self._follow(self._editor, state, state.playhead.position_us(time.monotonic()))

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
        """The person clicked on the pictures, at a point of their sheet."""
        if self._editor is not None:
            self._pointer.click(self._editor, x, y)

    def _pick(self, point: Point) -> None:
        """An event in space was clicked: look there, and choose its cluster in Tune, too."""
        if self._editor is not None and self._active:
            now = self._editor.labelling
            self._host.send(PickCluster(PickedPoint(now.view.camera, now.t_us, point)))
            self._pointer.look_at(self._editor, point)

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
        if self._pointer.ring is None:
            self._pictures.move_to(point)

    # Pictures -----------------------------------------------------------------------------------------------------

    def _scene(self, editor: LabelEditor, state: ClientState) -> LabelScene:
        aspect = self._host.plane.free_aspect
        return LabelScene(editor.labelling, state.look.rendering, state.look.colours, self._pointer.ring, aspect)

    def _show_mosaic(self, request: object, editor: LabelEditor, mosaic: LabelMosaic) -> None:
        if self._active and editor is self._editor:
            editor.show(mosaic.plan)
            self._host.plane.show(mosaic.sheet, request)
            self._pictures.show(mosaic)
            self._live.shown(editor.labelling.recording, mosaic.plan.t_us)

    def _dragged(self, phase: DragPhase, start: Point, end: Point) -> None:
        self._host.later(lambda: self._drag(phase, start, end))

    def _drag(self, phase: DragPhase, start: Point, end: Point) -> None:
        if self._editor is not None and self._active:
            self._pointer.drag(self._editor, phase, start, end)

    # What a person asks for ---------------------------------------------------------------------------------------

    def _act(self, name: str) -> None:
        if self._editor is not None and self._active:
            self._catch_up()
            self._keys.press(name)

    def _waits(self, name: str) -> bool:
        """Whether what this act judges is still to come."""
        if self._editor is None or self._suggestions is None:
            return False
        if self.middle != "sheet":  # in space and time no picture comes on which it could be judged
            return False
        match JUDGES.get(name):
            case "picture":
                return not self._editor.labelling.on_screen
            case "proposals":
                return not self._suggestions.segment_due
            case None:
                return False

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
            self._display.forget()
            self._catch_up()
            self._editor.do(act)

    def _use_name(self, text: str) -> None:
        self._sign_in.use(text)

    def _name_layer(self, name: str) -> None:
        self._do(lambda editor: editor.change_view({"annotator": name}))

    def _may_write(self, act: EditorAct) -> bool:
        """Labels belong to somebody, and to a recording that stays; else first things first."""
        assert self._editor is not None
        self._answered = True
        if isinstance(self._recording, RingRecording):
            self._freeze(self._recording, lambda: self._do(act))
            return False
        if not self._sign_in.named:
            editor = self._editor
            again = lambda: self._do(act) if editor is self._editor else None  # noqa: E731
            self._sign_in.ask(editor.labelling.view.annotator, again)
            return False
        remember_annotator(self._host.services.workspace.labels, self._editor.labelling.view.annotator)
        return True

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

    def _name(self) -> str:
        """The name that the field shows: of whoever labels here, or labelled last in this workspace."""
        if self._editor is not None:
            return self._editor.labelling.view.annotator
        return self._view.annotator if self._sign_in.named else last_annotator(self._host.services.workspace.labels)

    def _open(self) -> None:
        if self._editor is not None or self._recording is None:
            return
        host, state = self._host, self._host.state
        callbacks = LabelCallbacks(
            self._may_write,
            host.later,
            self._report,
            self._note,
            lambda t_us: host.apply(Seek(t_us)),
        )
        step_us = DEFAULT_STEP_US if state is None else state.step_us
        self._view = replace(self._view, annotator=self._name())
        labelling = begin_labelling(self._recording, self._view, step_us, time.monotonic())
        host.pool.submit(load_snap)
        self._editor = LabelEditor(host.services.label_stores, labelling, callbacks, self._session)
        self._suggestions = LabelSuggestions(
            self._editor, host.pool, lambda uuid: read_moments(host.services.workspace.root, uuid)
        )
        self._comparer = LabelComparer(self._editor, host.services.workspace.labels, self._other_stores, host.pool)
        self._panel.offer_cameras(tuple(labelling.sources))
        self._pictures.begin()
        self._display.forget()

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
