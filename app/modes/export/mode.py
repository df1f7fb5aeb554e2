"""Export: write what is open, or a training run, in the formats of other tools, or send it to a Rerun viewer.

What is sent is the part of a recording that would be exported, or the live rally from now on.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.export.exporter import ExportState
from app.export.formats import FORMATS, ExportRequest, export, time_note
from app.export.frozen import freeze
from app.export.selection import Span
from app.export.unfinished import Cancelled, Progress
from app.export.view_film import ViewFilmPlan, export_view_film, save_picture
from app.modes.export.files_panel import ExportFilesPanel, ViewerPanel, result_of_kind
from app.modes.export.plan_panel import (
    VIEW_PICTURE,
    AnnotatorQuestion,
    ExportPlan,
    ExportPlanPanel,
    made_with_html,
    part_of,
)
from app.modes.export.view_shots import ViewShots
from app.modes.mode import Middle, ModeHost, download_export
from app.shared.live_rally import LiveRally
from app.state.client_state import ClientState
from app.state.commands import TogglePlay
from app.widgets import when_clicked
from core.chain import ChainConfig
from core.detection.saved import SavedDetector
from core.errors import CommandError
from core.extras import require_package
from core.live.ring_recording import RingRecording
from core.recordings import Recording
from core.recordings.layout import Rows
from labels.arrays import LabelArrays
from labels.store import LabelStore, find_annotators, find_layers


@dataclass(frozen=True, slots=True, eq=False)
class StreamOrder:
    """Everything that a stream takes."""

    address: str
    name: str
    recording: Recording
    plan: ExportPlan
    detector: SavedDetector
    labels: Path
    """The folder of all labels."""
    live: LiveRally | None

    def check(self) -> None:
        """Say at once what is wrong with it.

        Raises:
            CommandError: if it cannot be sent.
        """
        if self.plan.what != "Recording":
            raise CommandError("a training run is not streamed", remedy="export it, and open the file in Rerun")
        if not isinstance(self.recording, RingRecording):
            part_of(self.recording, self.plan)

    def send(self, progress: Progress, cancelled: Cancelled, remark: Callable[[str], None]) -> None:
        """Send it; a live rally until it is cancelled.

        Raises:
            RallyscopeError: if there is no viewer, or it is lost.
            ExportCancelledError: if `cancelled()` is true.
        """
        require_package("rerun", "a stream to a Rerun viewer")
        from app.export.rrd.recording import RrdContents  # Rerun is loaded when it is wanted
        from app.export.rrd.viewer import stream_live, stream_recording

        plan, recording = self.plan, self.recording
        contents = RrdContents(
            chain=ChainConfig.of_method(*self.detector),
            stride_us=plan.stride_us,
            pictures=plan.pictures,
            stages=plan.stages,
            plots=plan.plots,
            labels=labels_of(self.labels, recording.uuid, plan.annotator),
        )
        groups = groups_of(recording, self.live)
        if isinstance(recording, RingRecording):
            with nullcontext() if self.live is None else self.live.kept_awake():
                stream_live(
                    recording, self.address, contents, name=self.name, groups=groups, cancelled=cancelled,
                    skipped=lambda us: remark(f"{us / 1e6:.1f} s were skipped: this machine is too slow"),
                )  # fmt: skip
            return
        span = part_of(recording, plan)
        stream_recording(
            recording, self.address, span, contents, name=self.name, groups=groups, progress=progress,
            cancelled=cancelled,
        )  # fmt: skip


def groups_of(recording: Recording, live: LiveRally | None) -> Callable[[str], Rows | None]:
    """What reads the further groups of a recording, such as "/racket"."""
    if isinstance(recording, RingRecording):
        return live.rows.read_rows if live is not None and live.recording is recording else _no_rows
    return getattr(recording, "read_rows", _no_rows)


def labels_of(folder: Path, recording_uuid: str, annotator: str | None) -> dict[str, LabelArrays]:
    """An annotator's labels by camera."""
    mine = [layer for layer in find_layers(folder, recording_uuid) if layer.annotator == annotator]
    return {layer.camera: LabelStore.read(folder, layer).labels() for layer in mine if not layer.blind}


def _no_rows(group: str) -> Rows | None:
    """What a recording without groups gives: no rows."""
    return None


LOOK_EVERY_S: Final = 0.3
OFFER_EVERY_S: Final = 2.0


class ExportMode:
    """Export as one browser sees it; the export that runs and the files are shared by all."""

    uses_recording = True
    takes_keys = False

    def __init__(self, host: ModeHost) -> None:
        self._host = host
        self._exporter = host.services.exporter
        self._now_us = 0
        self._shots = ViewShots(host)
        self._labelled_by: tuple[str, ...] = ()
        self._made_as: dict[str, str] = {}
        """Kind of each file that this browser has ordered, by name."""
        self._looked_s = self._offered_s = float("-inf")
        self._question: AnnotatorQuestion | None = None
        self._folder = host.client.gui.add_folder(None, visible=False)
        with self._folder:
            self._plan = ExportPlanPanel(host.client.gui, lambda: self._now_us, host.later)
            self._made_with = host.client.gui.add_html("")
            self._files = ExportFilesPanel(host.client.gui)
            self._viewer = ViewerPanel(
                host.client.gui,
                host.services.viewer.address,
                lambda: host.later(self._stream),
                host.services.viewer.stop,
            )
        when_clicked(self._files.export, lambda: host.later(self._start))
        when_clicked(self._files.cancel, self._exporter.cancel)
        when_clicked(self._files.download, lambda: host.later(self._download))

    @property
    def middle(self) -> Middle:
        """What is at the cursor: where a part begins and ends is found by looking."""
        return "world" if self._shots.rally is not None and self._plan.plan.of_view else "events"

    @property
    def latest(self) -> ExportState | None:
        """The latest export, if this browser asked for it."""
        latest = self._exporter.state()
        return latest if latest is not None and latest.name in self._made_as else None

    @property
    def needs_tick(self) -> bool:
        """The session's loop turns often enough for a progress bar; a 3D view of a live rally moves."""
        return self.middle == "world" and isinstance(self._host.recording, RingRecording)

    def show(self, active: bool) -> None:
        """Show the controls or hide them."""
        self._folder.visible = active
        self._looked_s = self._offered_s = float("-inf")
        if not active:
            self._shots.leave()
        recording = self._host.recording
        if active and isinstance(recording, RingRecording):
            self._plan.use_span(recording.start_us, recording.duration_us)

    def use_recording(self, recording: Recording) -> None:
        """Offer all of it."""
        self._shots.use(self._host.services.rallies.of(recording))
        start_us = recording.start_us if isinstance(recording, RingRecording) else 0
        self._plan.use_span(start_us, recording.duration_us)

    def tick(self, state: ClientState, now_us: int, wall_s: float) -> None:
        """Follow the export and the folder."""
        self._now_us = now_us
        if self.middle == "world":
            self._shots.draw(state, now_us)
        elif self._shots.running:
            self._shots.leave()
        if wall_s - self._looked_s < LOOK_EVERY_S:
            return
        self._looked_s = wall_s
        with self._host.client.atomic():
            if wall_s - self._offered_s > OFFER_EVERY_S:
                self._offered_s = wall_s
                self._labelled_by = self._annotators()
                runs = tuple(sorted(self._host.services.workspace.run_names()))
                self._plan.offer(runs, self._labelled_by, state.annotator)
            made_with = made_with_html(self._plan.plan, state.detector, state.tune.slot, self._labelled_by)
            if made_with != self._made_with.content:
                self._made_with.content = made_with
            latest = self._exporter.state()
            made_as = None if latest is None else self._made_as.get(latest.name)
            self._files.show(result_of_kind(latest, made_as, self._plan.plan.kind), self._exporter.files())
            self._viewer.show(self._host.services.viewer.state())

    def clicked(self, x: float, y: float) -> None:
        """Nothing is chosen by clicks."""

    def close(self) -> None:
        """The browser is gone; an export goes on, unless the browser was to draw it."""
        self._shots.close()

    def _annotators(self) -> tuple[str, ...]:
        if self._host.recording is None:
            return ()
        return find_annotators(self._host.services.workspace.labels, self._host.recording.uuid)

    def _start(self) -> None:
        plan, state = self._plan.plan, self._host.state
        if plan.what == "Training run":
            if plan.run is None or plan.run not in self._host.services.workspace.run_names():
                raise CommandError("no training run to export", remedy="train one in the mode Train")
            run = self._host.services.workspace.run_path(plan.run)
            self._made_as[self._exporter.start(plan.run, ".rrd", _run_work(run))] = plan.kind
            return
        recording = self._host.recording
        if recording is None or state is None:
            raise CommandError("no recording is open", remedy="choose one under Recording")
        span = part_of(recording, plan)  # says at once what is wrong with it
        if plan.of_view:
            self._start_view(plan, span, state)
            return
        if plan.asks_annotator and plan.format == "rrd":
            self._ask_annotator(self._start)
            return
        layers = self._host.services.workspace.labels
        live = self._host.services.rallies.live
        work = _recording_work(recording, plan, state.detector, layers, live)
        note = partial(time_note, plan.format, recording, span)
        name = self._exporter.start(state.recording, FORMATS[plan.format].suffix, work, note)
        self._made_as[name] = plan.kind
        self._looked_s = float("-inf")

    def _stream(self) -> None:
        """What the Rerun file would hold, to the viewer of the command line."""
        state, recording, services = self._host.state, self._host.recording, self._host.services
        if state is None or recording is None or services.viewer.address is None:
            return
        order = StreamOrder(
            services.viewer.address, state.recording, recording, self._plan.plan, state.detector,
            services.workspace.labels, services.rallies.live,
        )  # fmt: skip
        order.check()
        if order.plan.asks_annotator:
            self._ask_annotator(self._stream)
            return
        services.viewer.start(state.recording, order.send)
        self._looked_s = float("-inf")

    def _ask_annotator(self, then: Callable[[], None]) -> None:
        """Ask whose labels are meant, then go on with `then`."""

        def chosen(name: str | None) -> None:
            self._question = None
            if name is not None:
                self._plan.choose_annotator(name)
                then()

        if self._question is None:
            host = self._host
            answer = lambda name: host.later(lambda: chosen(name))  # noqa: E731
            self._question = AnnotatorQuestion(host.client.gui, self._labelled_by, answer)

    def _start_view(self, plan: ExportPlan, span: Span, state: ClientState) -> None:
        """A picture of the moment of the cursor, or a film of the part; the cursor stands still for it."""
        shots, host, view = self._shots, self._host, plan.view
        if shots.rally is None:
            remedy = "import it with --calibration, or export the events"
            raise CommandError("no 3D view of this recording", expected="two cameras, calibrated", remedy=remedy)
        film = ViewFilmPlan(
            span=span,
            speed=view.speed,
            frames_per_s=view.frames_per_s,
            width_px=view.width_px,
            height_px=view.height_px,
        )
        times_us = (self._now_us,) if plan.format == VIEW_PICTURE else film.times_us()
        # A live view cannot stand still: its moments are kept before.
        paused = state.playhead.playing and not state.playhead.live
        shots.begin()

        def work(path: Path, progress: Progress, cancelled: Cancelled) -> tuple[Path, ...]:
            def picture_at(t_us: int) -> NDArray[np.uint8]:
                return shots.picture_at(t_us, (view.width_px, view.height_px), cancelled)

            try:
                shots.keep(times_us, cancelled)
                if plan.format == VIEW_PICTURE:
                    return (save_picture(path, picture_at(times_us[0])),)
                return (export_view_film(path, film, picture_at, progress=progress, cancelled=cancelled),)
            finally:
                host.later(lambda: self._end_view(state.recording, playing=paused))

        try:
            suffix = ".png" if plan.format == VIEW_PICTURE else ".mp4"
            self._made_as[self._exporter.start(f"{state.recording}-3d", suffix, work)] = plan.kind
        except CommandError:
            shots.end()
            raise
        if paused:
            host.send(TogglePlay())
        self._looked_s = float("-inf")

    def _end_view(self, recording: str, *, playing: bool) -> None:
        """The cursor goes on from where it stood."""
        self._shots.end()
        state = self._host.state
        if playing and state is not None and state.recording == recording and not state.playhead.playing:
            self._host.send(TogglePlay())

    def _download(self) -> None:
        if self._files.chosen is not None:
            download_export(self._host, self._files.chosen)


def _run_work(run: Path) -> Callable[[Path, Progress, Cancelled], tuple[Path, ...]]:
    def work(path: Path, progress: Progress, cancelled: Cancelled) -> tuple[Path, ...]:
        return export(ExportRequest(format="rrd", destination=path), run=run, progress=progress, cancelled=cancelled)

    return work


def _recording_work(
    recording: Recording, plan: ExportPlan, detector: SavedDetector, labels: Path, live: LiveRally | None
) -> Callable[[Path, Progress, Cancelled], tuple[Path, ...]]:
    def work(path: Path, progress: Progress, cancelled: Cancelled) -> tuple[Path, ...]:
        source, span = recording, part_of(recording, plan)
        if isinstance(recording, RingRecording):
            source = freeze(recording, span)
        order = ExportRequest(
            format=plan.format,
            destination=path,
            start_us=span.start_us,
            end_us=span.end_us,
            stride_us=plan.stride_us if plan.format == "rrd" else None,
            pictures=plan.pictures,
            stages=plan.stages,
            plots=plan.plots,
            chain=ChainConfig.of_method(*detector),
        )
        shown = labels_of(labels, source.uuid, plan.annotator)
        groups = groups_of(recording, live)
        return export(order, recording=source, groups=groups, labels=shown, progress=progress, cancelled=cancelled)

    return work
