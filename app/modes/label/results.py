"""What labels are good for: files that are downloaded, and the measure of a detector."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

import viser

from app import theme
from app.export.unfinished import Cancelled, Progress
from app.formatting import html_text, note_html, percent
from app.modes.label.editor import LabelEditor
from app.modes.label.label_files import LabelFiles, LabelFilesRequest, copy_label_store, zip_label_files
from app.modes.mode import ModeHost, download_export
from app.state.client_state import ClientState
from app.state.commands import AskForScore
from app.state.config_words import detector_words
from app.widgets import titles_of, when_clicked
from core.errors import CommandError
from core.text import counted
from labels.formats import FORMATS, ExportOptions
from labels.model import ContactLabel, Label
from labels.store import LabelStore, Layer, has_labels

STYLE: Final = "padding:2px 12px;font-size:12.5px;line-height:1.45"


STORE: Final = "store"
STORE_TITLE: Final = "Label store (all annotators)"
FORMAT_HINT: Final = (
    "A ZIP of your labels in this camera. CSV and JSON hold all; the others lose uncertainties, most also contacts. "
    "The store has all cameras, annotators and changes"
)
FIRST_FORMAT: Final = "csv"
"""What is downloaded without a choice loses nothing."""


class LabelResultsPanel:
    """Controls of export and import of labels in one browser."""

    def __init__(
        self, gui: viser.GuiApi, score: Callable[[], None], export: Callable[[], None], cancel: Callable[[], None]
    ) -> None:
        self._titles = titles_of({name: kind.label for name, kind in FORMATS.items()} | {STORE: STORE_TITLE})
        with gui.add_folder("With these labels"):
            self._scored = gui.add_html("")
            scoring = gui.add_button(
                "Score the detector", icon=viser.Icon.TARGET, hint="Tune's method and config against your labels here"
            )
            self._format = gui.add_dropdown(
                "Format", tuple(self._titles.values()), initial_value=self._titles[FIRST_FORMAT], hint=FORMAT_HINT
            )
            self._pictures = gui.add_checkbox(
                "With pictures", False, hint="A PNG of the events of each label; CSV has none"
            )
            self._export = gui.add_button(
                "Download labels", icon=viser.Icon.DOWNLOAD, color="teal", hint="One file for this computer"
            )
            self._cancel = gui.add_button("Cancel", icon=viser.Icon.X, visible=False)
            self._status = gui.add_html("")
        when_clicked(scoring, score)
        when_clicked(self._export, export)
        when_clicked(self._cancel, cancel)

    @property
    def format(self) -> str:
        """Name of the chosen format."""
        return next((name for name, title in self._titles.items() if title == self._format.value), FIRST_FORMAT)

    @property
    def pictures(self) -> bool:
        """Whether pictures are wanted and the format has any."""
        return bool(self._pictures.value) and self.format != STORE and FORMATS[self.format].pictures

    def show_scored(self, text: str) -> None:
        """Which detector would be scored."""
        content = note_html(f"Scores what Tune shows: {html_text(text)}", theme.MUTED)
        if self._scored.content != content:
            self._scored.content = content

    def show(self, lines: tuple[str, ...], *, running: bool, failed: bool) -> None:
        """How the export goes, or how it ended."""
        self._export.visible, self._cancel.visible = not running, running
        colour = theme.BAD if failed else theme.MUTED
        text = "<br>".join(html_text(line) for line in lines)
        content = f"<div style='{STYLE};color:{colour}'>{text}</div>" if lines else ""
        if self._status.content != content:
            self._status.content = content


SAVED_WITHIN_S: Final = 10.0
SHOW_EVERY_S: Final = 0.3


class LabelResults:
    """Exports and imports labels for one browser. Called by its loop."""

    def __init__(self, host: ModeHost) -> None:
        self._host = host
        self._editor: LabelEditor | None = None
        self._panel = LabelResultsPanel(
            host.client.gui,
            lambda: host.later(self._score),
            lambda: host.later(self._export),
            lambda: host.later(self._cancel),
        )
        self._name: str | None = None
        """Name of the file that is being made."""
        self._made: LabelFiles | None = None
        self._shown_s = float("-inf")

    def tick(self, editor: LabelEditor, now: ClientState, wall_s: float) -> None:
        """Follow Tune's choice of the detector and the export; hand the file over when it is there."""
        self._editor = editor
        if wall_s - self._shown_s < SHOW_EVERY_S:
            return
        self._shown_s = wall_s
        self._panel.show_scored(detector_words(now))
        if self._name is None:
            return
        state = self._host.services.exporter.state()
        if state is None or state.name != self._name:
            self._name = None
            self._panel.show((), running=False, failed=False)
        elif state.running:
            self._panel.show((f"{self._name}: {percent(state.share)}",), running=True, failed=False)
        else:
            name, made, self._name = self._name, self._made, None
            lines = (state.message,)
            if made is not None and not state.failed and state.message != "cancelled":
                labels, pictures = counted(made.labels, "label"), counted(len(made.pictures), "picture")
                lines += (f"{labels}, {pictures}; also in the folder exports",)
                lines += tuple(f"not in this format: {loss}" for loss in made.losses)
                download_export(self._host, name)
            self._panel.show(lines, running=False, failed=state.failed)

    def _score(self) -> None:
        """Tune's method and config, against these labels."""
        editor, state = self._editor, self._host.state
        if editor is None or state is None:
            return
        view = editor.labelling.view
        if view.camera not in state.cameras:
            raise CommandError("the detector works on events", got=f"the frames of {view.camera!r}")
        if not editor.labelling.here.labels:
            raise CommandError("no labels to score against", got=f"camera {view.camera}, {view.annotator}")
        self._host.send(AskForScore(view.camera, view.annotator))

    def _export(self) -> None:
        editor = self._editor
        if editor is None or self._name is not None:
            return
        now, folder = editor.labelling, self._host.services.workspace.labels
        layer = replace(now.layer, blind=False)
        chosen, pictures, source = self._panel.format, self._panel.pictures, now.source

        def work(path: Path, progress: Progress, cancelled: Cancelled) -> tuple[Path, ...]:
            # The file is read from the store, not from the screen.
            _wait_until_saved(editor)
            if chosen == STORE:
                self._made = copy_label_store(folder, layer.recording_uuid, path)
                return (path,)
            labels, contacts = _stored_in(folder, layer)
            request = LabelFilesRequest(
                format=chosen,
                recording_uuid=layer.recording_uuid,
                annotator=layer.annotator,
                source=source,
                labels=labels,
                contacts=contacts,
                pictures=pictures,
                options=ExportOptions(drop_unchecked=True),
            )
            self._made = zip_label_files(request, path, progress, cancelled)
            return (path,)

        of_store = chosen == STORE
        what = ("labels",) if of_store else (now.view.camera, layer.annotator, chosen)
        self._made = None
        stem = "-".join((self._recording_name, *what))
        self._name = self._host.services.exporter.start(stem, ".sqlite" if of_store else ".zip", work)
        self._shown_s = float("-inf")

    @property
    def _recording_name(self) -> str:
        return "labels" if self._host.state is None else self._host.state.recording

    def _cancel(self) -> None:
        state = self._host.services.exporter.state()
        if state is not None and state.name == self._name:
            self._host.services.exporter.cancel()


def _stored_in(folder: Path, layer: Layer) -> tuple[tuple[Label, ...], tuple[ContactLabel, ...]]:
    """Labels and contacts of a layer; none if nobody has begun it."""
    if not has_labels(folder, layer):
        return (), ()
    with LabelStore.read(folder, layer) as store:
        return store.all(), store.contacts()


def _wait_until_saved(editor: LabelEditor) -> None:
    """What was labelled before the button was pressed belongs to the file."""
    until_s = time.monotonic() + SAVED_WITHIN_S
    while editor.writer.waiting:
        if time.monotonic() > until_s:
            raise CommandError("the last labels are not saved yet", remedy="wait until they are, then export again")
        time.sleep(0.02)
