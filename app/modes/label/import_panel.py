"""Import of label files, in Label's panel: what would be taken is shown with pictures before anything is stored."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from app import theme
from app.background.jobs import LatestWins
from app.formatting import html_text, note_html
from app.modes.label.annotator import annotator_from
from app.modes.label.editor import LabelEditor
from app.modes.label.label_files import (
    FOLDER,
    ImportAsk,
    ImportPreview,
    files_to_import,
    preview_html,
    preview_import,
)
from app.modes.label.received_labels import place_label_file
from app.modes.mode import ModeHost
from app.web.pages import Json
from app.widgets import Listing, titles_of, when_clicked
from core.errors import CommandError, LabelError, RallyscopeError
from core.files import end_unfinished
from core.live.ring_recording import RingRecording
from core.text import counted
from labels.contacts import new_contacts
from labels.formats import FORMATS
from labels.store import LabelStore

LIST_EVERY_S: Final = 2.0
NO_TABLE: Final = "none"
TOOL: Final = "rallyscope, Import labels"
COMPARE: Final = "It is a label store: choose it in Compare and merge."
IMPORTED: Final = "imported"
"""Whose labels they become, unless another name is given."""


class LabelImportPanel:
    """Controls of the import of labels in one browser, folded."""

    def __init__(
        self,
        gui: viser.GuiApi,
        upload: Callable[[], None],
        look: Callable[[], None],
        accept: Callable[[], None],
        discard: Callable[[], None],
    ) -> None:
        self._titles = titles_of({name: kind.label or kind.name for name, kind in FORMATS.items()})
        with gui.add_folder("Import labels", expand_by_default=False):
            sending = gui.add_button(
                "Upload labels ...", icon=viser.Icon.UPLOAD, hint="A file, a ZIP or a label store of this computer"
            )
            hint = f"A file or folder in the folder {FOLDER} of the workspace"
            self._files = Listing(gui, "Files", lambda title: None, hint=hint)
            self._format = gui.add_dropdown("Made by", tuple(self._titles.values()), hint="The format of the files")
            self._times = Listing(
                gui,
                "Times",
                lambda title: None,
                hint="A CSV beside them with the times of the pictures in a column t_us",
            )
            self._ball = gui.add_text("Ball class", "", hint="Name or number, if it is not 'ball'")
            self._scale = gui.add_checkbox("Scale pictures", False, hint="Their size differs from the sensor's")
            self._empty = gui.add_checkbox(
                "Pictures without a label mean 'no ball'", False, hint="Choose it if somebody looked at every picture"
            )
            self._annotator = gui.add_text("Labels of", IMPORTED, hint="The name under which they are stored")
            self._look = gui.add_button("Look at them", icon=viser.Icon.EYE, hint="Nothing is stored yet")
            self._status = gui.add_html("")
            self._picture = gui.add_image(np.zeros((2, 2, 3), np.uint8), visible=False)
            self._accept = gui.add_button("Accept", icon=viser.Icon.CHECK, color="green", visible=False)
            self._discard = gui.add_button("Discard", icon=viser.Icon.X, visible=False)
        when_clicked(sending, upload)
        when_clicked(self._look, look)
        when_clicked(self._accept, accept)
        when_clicked(self._discard, discard)

    @property
    def format(self) -> str:
        """Name of the chosen format."""
        return next(name for name, title in self._titles.items() if title == self._format.value)

    @property
    def chosen(self) -> tuple[str | None, str | None]:
        """The files, and the table of times."""
        times = self._times.chosen
        return self._files.chosen, None if times == NO_TABLE else times

    @property
    def choices(self) -> tuple[str, bool, bool]:
        """Which class is the ball, whether pictures are scaled, and whether empty ones have no ball."""
        return self._ball.value, bool(self._scale.value), bool(self._empty.value)

    @property
    def annotator(self) -> str:
        """Whose labels they become."""
        return self._annotator.value

    def offer(self, names: tuple[str, ...]) -> None:
        """What lies in the folder."""
        self._files.offer(names)
        self._times.offer((NO_TABLE, *(name for name in names if name.lower().endswith(".csv"))))

    def choose(self, name: str) -> None:
        """Choose a file or folder of those that are offered."""
        self._files.show(name)

    def show(self, html: str, picture: NDArray[np.uint8] | None, taken: int) -> None:
        """What would be taken, with its pictures; or a line about it."""
        self._status.content = html
        self._picture.visible = picture is not None
        if picture is not None:
            self._picture.image = picture
        self._accept.visible = self._discard.visible = taken > 0
        self._accept.label = f"Accept {counted(taken, 'label')}"


@dataclass(frozen=True, slots=True, eq=False)
class AcceptAsk:
    """Labels that are to be stored."""

    preview: ImportPreview
    recording_uuid: str
    camera: str
    annotator: str


class LabelImports:
    """Looks at label files and stores what is accepted, for one browser. Called by its loop."""

    def __init__(self, host: ModeHost) -> None:
        self._host = host
        self._editor: LabelEditor | None = None
        self._preview: ImportPreview | None = None
        self._listed_s = float("-inf")
        self._panel = LabelImportPanel(
            host.client.gui,
            lambda: host.later(self._show_dialog),
            lambda: host.later(self._look),
            lambda: host.later(self._accept),
            lambda: host.later(self._discard),
        )
        self._previews = LatestWins(
            host.pool,
            preview_or_error,
            lambda ask, answer: host.later(lambda: self._show(ask, answer)),
            lambda error: host.later(lambda: self._fail(error)),
        )
        self._accepting = LatestWins(
            host.pool,
            self._store,
            lambda ask, answer: host.later(lambda: self._stored(ask, answer)),
            lambda error: host.later(lambda: self._fail(error)),
        )
        self._listing = LatestWins(
            host.pool,
            files_to_import,
            lambda _, found: host.later(lambda: self._panel.offer(tuple(found))),
            host.report,
        )
        self._sent = 0
        """Number of messages to the page, so that it tells them apart."""
        host.receive(self._received, "labels")

    def tick(self, editor: LabelEditor, wall_s: float) -> None:
        """Look, now and then, which files there are."""
        if editor is not self._editor:
            self._editor = editor
            self._discard()
        if self._preview is not None and self._preview.ask.source is not editor.labelling.source:
            self._discard()
        if wall_s - self._listed_s >= LIST_EVERY_S:
            self._listed_s = wall_s
            self._listing.submit(self._host.services.workspace.root)

    def close(self) -> None:
        """The browser is gone."""
        for worker in (self._previews, self._accepting, self._listing):
            worker.close()

    def _tell_page(self, kind: str, **values: Json) -> None:
        self._sent += 1
        self._host.send_to_page(kind, {"number": self._sent, **values})

    def _show_dialog(self) -> None:
        self._tell_page("label_files_dialog")

    def _received(self, path: Path) -> None:
        """In the server's event loop: what the page sent goes where the import looks, off it."""
        self._host.pool.submit(self._place, path)

    def _place(self, path: Path) -> None:
        host, workspace = self._host, self._host.services.workspace.root
        try:
            name = place_label_file(path, workspace)
        except (RallyscopeError, OSError) as error:
            problem = f"{path.name}: {str(error).replace(f'{path.parent}{os.sep}', '')}"
            host.later(lambda: self._tell_page("label_file", problem=problem))
            return
        finally:
            end_unfinished(path.parent)
        found = tuple(files_to_import(workspace))
        host.later(lambda: self._placed(name, found))

    def _placed(self, name: str, found: tuple[str, ...]) -> None:
        self._tell_page("label_file", problem="")
        self._discard()
        self._panel.offer(found)
        self._panel.choose(name)
        of_store = name not in found
        text = f"Uploaded: {name}. " + (COMPARE if of_store else "Choose what made it, then look at it.")
        self._panel.show(note_html(html_text(text), theme.GOOD), None, 0)

    def _look(self) -> None:
        if self._editor is None:
            return
        recording = self._editor.labelling.recording
        if isinstance(recording, RingRecording):
            raise CommandError("label files are of a recording", got="a live source", remedy="record it first")
        # The browser gives a name; where that lies is looked up here.
        found, (name, table) = files_to_import(self._host.services.workspace.root), self._panel.chosen
        if name is None or name not in found:
            raise CommandError("no label files", remedy=f"put them into the folder {FOLDER} of the workspace")
        ball, scale, empty = self._panel.choices
        times = found.get(table or "")
        self._preview = None
        self._panel.show(note_html("looking", theme.MUTED), None, 0)
        source = self._editor.labelling.source
        self._previews.submit(ImportAsk(found[name], self._panel.format, times, ball, scale, empty, recording, source))

    def _show(self, ask: ImportAsk, answer: ImportPreview | RallyscopeError) -> None:
        if self._editor is None or ask.source is not self._editor.labelling.source:
            return
        if isinstance(answer, RallyscopeError):
            text = str(answer).replace(str(self._host.services.workspace.root), "")
            self._panel.show(note_html(html_text(text), theme.BAD), None, 0)
            return
        self._preview = answer
        taken = answer.report.taken + answer.report.contacts
        self._panel.show(preview_html(answer, ask.path.parent), answer.picture, taken)

    def _discard(self) -> None:
        self._preview = None
        self._panel.show("", None, 0)

    def _accept(self) -> None:
        if self._editor is None or self._preview is None:
            return
        preview, self._preview = self._preview, None
        annotator = annotator_from(self._panel.annotator or IMPORTED)
        self._panel.show(note_html("storing", theme.MUTED), None, 0)
        recording_uuid = self._editor.labelling.recording.uuid
        self._accepting.submit(AcceptAsk(preview, recording_uuid, preview.ask.source.name, annotator))

    def _store(self, ask: AcceptAsk) -> tuple[int, int] | LabelError:
        """Store what is new, as one step; how many, and how many were there already."""
        folder = self._host.services.label_stores.folder
        try:
            with LabelStore.open(folder, ask.recording_uuid, ask.camera, ask.annotator, tool=TOOL) as store:
                found = ask.preview.found
                new = [label for label in found.labels if store.at(label.t_us) is None]
                contacts = new_contacts(found.contacts, store.contacts())
                store.edit(put=new, put_contacts=contacts)
        except LabelError as error:
            return error
        return len(new) + len(contacts), len(found.labels) + len(found.contacts) - len(new) - len(contacts)

    def _stored(self, ask: AcceptAsk, answer: tuple[int, int] | LabelError) -> None:
        if isinstance(answer, LabelError):
            self._panel.show(note_html(html_text(str(answer)), theme.BAD), None, 0)
            return
        there = f", {answer[1]} there already" if answer[1] else ""
        text = f"{counted(answer[0], 'label')} stored for {ask.annotator!r}, camera {ask.camera}{there}"
        more = "To see them, choose that name under Annotator, or compare with it."
        self._panel.show(note_html(html_text(text), theme.GOOD) + note_html(more, theme.MUTED), None, 0)

    def _fail(self, error: Exception) -> None:
        """A mistake of ours."""
        self._discard()
        self._host.report(error)


def preview_or_error(ask: ImportAsk) -> ImportPreview | RallyscopeError:
    """What would be taken, or why it cannot be told."""
    try:
        return preview_import(ask)
    except RallyscopeError as error:
        return error
