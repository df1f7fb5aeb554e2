"""What the selected balls are used as: moments to label, launches to train on, or a data set of their flights."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from app.background.jobs import LoopJob, Progress
from app.export.flight_set import write_flight_set
from app.modes.mode import ModeHost
from app.shared.ball_index import BallIndex
from app.shared.workspace import Workspace, free_path, slug_from, taken_text
from core.errors import CommandError
from core.files import numbered
from core.recordings import open_recording
from core.text import counted

TO_LABEL: Final = "To label"
TRAINING: Final = "Training"
DATA_SET: Final = "Data set"
Work = Callable[[Progress, Callable[[], bool]], str]


class BallSelectionPanel:
    """The controls of one browser. Methods are called by its loop; the work is done off it."""

    def __init__(self, gui: viser.GuiApi, host: ModeHost) -> None:
        self._host = host
        self._index: BallIndex | None = None
        self._rows: NDArray[np.int64] = np.zeros(0, np.int64)
        self._selected_by = ""
        self._job: LoopJob[str] = LoopJob(host.later, host.report, self._show_running)
        self._name = gui.add_text("Name", "balls", hint="Name of the data set or the file", visible=False)
        hint = (
            "To label: key K in Label goes there first. Training: a file for `rallyscope train --balls`. Data set: the "
            "events of their flights, with labels or the truth"
        )
        self._uses = gui.add_button_group("Use these as", (TO_LABEL, TRAINING, DATA_SET), hint=hint, visible=False)
        self._stop = gui.add_button("Stop writing", icon=viser.Icon.X, visible=False)
        self._progress = gui.add_progress_bar(0.0, visible=False)

        @self._uses.on_click
        async def _(event: viser.GuiEvent) -> None:
            use = str(event.target.value)
            host.later(lambda: self._use(use))

        @self._stop.on_click
        async def _(_: viser.GuiEvent) -> None:
            host.later(self._job.cancel)

    def offer(self, index: BallIndex, rows: NDArray[np.int64], selected_by: str) -> None:
        """These rows of the index are shown now, because they were selected so."""
        self._index, self._rows, self._selected_by = index, rows, selected_by
        self._show_running()

    def tick(self) -> None:
        """Show the progress."""
        if self._job.share is not None and abs(self._progress.value - 100 * self._job.share) >= 1:
            self._progress.value = 100 * self._job.share

    def close(self) -> None:
        """The browser has disconnected."""
        self._job.close()

    def _show_running(self) -> None:
        running = self._job.running
        self._stop.visible = self._progress.visible = running
        self._name.visible = self._uses.visible = not running and self._index is not None and len(self._rows) > 0

    def _use(self, use: str) -> None:
        if self._index is None or self._job.running:
            return
        index, rows, workspace = self._index, self._rows, self._host.services.workspace
        work: Work
        if use == TO_LABEL:
            work = lambda progress, cancelled: list_to_label(index, rows, workspace, progress, cancelled)  # noqa: E731
        elif use == DATA_SET:
            name, how = slug_from(str(self._name.value)), self._selected_by
            work = lambda progress, cancelled: write_data_set(  # noqa: E731
                index, rows, workspace, name, how, progress, cancelled
            )
        else:
            name = slug_from(str(self._name.value))
            work = lambda progress, cancelled: write_training(index, rows, workspace, name)  # noqa: E731
        self._job.start(work, lambda text: self._host.note("Selected balls", text, "green"))
        self._show_running()


def list_to_label(
    index: BallIndex,
    rows: NDArray[np.int64],
    workspace: Workspace,
    progress: Progress = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> str:
    """Make the times of these rows the list that is to be labelled; a sentence of what was done.

    Raises:
        CommandError: if none of them has a recording.
        RecordingError: if a recording is gone.
        LabelError: if the list cannot be written.
    """
    from labels.balls.to_label import write_moments

    times = index.table.column("t_us")
    by_source: dict[int, list[int]] = {}
    for row, source in zip(
        rows.tolist(), (np.searchsorted(index.first_rows, rows, side="right") - 1).tolist(), strict=True
    ):
        if index.sources[source].kind != "run" and (t_us := times[row].as_py()) is not None:
            by_source.setdefault(source, []).append(t_us)
    if not by_source:
        raise CommandError("no ball of a recording among these", remedy="select some of a recording or a data set")
    moments = {}
    for number, (source, listed) in enumerate(by_source.items(), start=1):
        if cancelled():
            return ""
        with closing(open_recording(index.sources[source].path)) as recording:
            moments[recording.uuid] = listed
        progress(number / len(by_source))
    write_moments(workspace.root, moments)
    count = sum(map(len, moments.values()))
    return f"Moments to label in {counted(len(moments), 'recording')}: {count:,}. Key K in Label goes to them"


def write_training(index: BallIndex, rows: NDArray[np.int64], workspace: Workspace, name: str) -> str:
    """Write the launches of these rows to a file among the exports, with a number where the name is taken.

    Returns:
        A sentence of what was done.

    Raises:
        CommandError: if there are too few.
        RecordingError: if the file cannot be written.
    """
    from labels.balls.launches import write_launches

    with free_path(workspace.exports / f"{free}.json" for free in numbered(name)) as path:
        done = write_launches(path, index.table.take(rows))
    left_out = f", {done.unknown:,} left out (state not known)" if done.unknown else ""
    return f"{taken_text(name, path)}{counted(done.written, 'launch')}{left_out}: rallyscope train --balls {path}"


def write_data_set(
    index: BallIndex,
    rows: NDArray[np.int64],
    workspace: Workspace,
    name: str,
    selected_by: str,
    progress: Progress = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> str:
    """Write the flights of these rows to a data set in the workspace, with a number where the name is taken.

    Returns:
        A sentence of what was done.

    Raises:
        CommandError: if nobody says where the ball is in any of them, or the folder cannot be written.
        RecordingError: if a recording is gone.
        LabelError: if labels cannot be read.
        ExportCancelledError: if `cancelled()` is true; nothing is left behind then.
    """
    with free_path(workspace.data_sets / free for free in numbered(name)) as folder:
        made = write_flight_set(
            index, rows, workspace.labels, folder, selected_by=selected_by, progress=progress, cancelled=cancelled
        )
    return f"{taken_text(name, folder)}{made}"
