"""Online learning in the live rally: figures, chart and controls, shared by all browsers."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from app import theme
from app.formatting import html_text
from app.modes.mode import ModeHost, do_in_pool
from app.shared.live_rally import LiveRally
from app.shared.rallies import learning_start, start_choices
from app.widgets import Listing, decades, log_scale, plot_axis, when_changed, when_clicked
from core.online_learning.progress import WINDOW, LearningProgress
from core.online_learning.start import NOTHING
from core.text import counted

Array = NDArray[np.float64]
SHOWN: Final = 300
"""Number of newest balls in the chart."""
RANGE_MM: Final = (1.0, 2000.0)
"""Range of the logarithmic chart; values beyond it, or unknown, are drawn at its edge."""
STYLE: Final = "font-size:12.5px;padding:2px 12px;line-height:1.45"


def reason_html(reason: str) -> str:
    """HTML of the reason why the controls are disabled."""
    return f"<div style='{STYLE};color:{theme.MUTED}'>{html_text(reason)}</div>"


def learning_html(progress: LearningProgress | None, *, on: bool) -> str:
    """HTML of the progress; empty before learning began."""
    if progress is None:
        return ""
    lines = [f"<b>{counted(progress.learned, 'ball')} learned from</b>, started from {html_text(progress.start)}"]
    if progress.balls:
        back, of = progress.returned_lately
        _, medians = progress.errors_mm()
        median = f"{medians[-1]:.0f} mm" if math.isfinite(medians[-1]) else "unknown"
        lines.append(f"last {of}: {back} returned, landing error {median} (median)")
        lines.append(f"all {len(progress.balls)}: {progress.returned} returned")
        if progress.balls[-1].random:
            lines.append("random strokes so far (exploration)")
    if not on:
        lines.append("another controller plays: not learning now")
    if progress.problem:
        lines.append(f"a ball was skipped: {html_text(progress.problem)}")
    return f"<div style='{STYLE}'>{'<br>'.join(lines)}</div>"


def chart_columns(progress: LearningProgress) -> tuple[Array, Array, Array]:
    """Number of each ball (from 1), its error and the running median, mm: (N,) each, within the chart's range."""
    errors, medians = progress.errors_mm()
    numbers = np.arange(1.0, len(errors) + 1)
    shown = slice(max(0, len(errors) - SHOWN), None)
    error, median = (np.clip(np.nan_to_num(one, nan=np.inf), *RANGE_MM)[shown] for one in (errors, medians))
    return numbers[shown], error, median


def chart_title_html() -> str:
    """HTML title of the chart."""
    return (
        f"<div style='font-size:12px;padding:0 12px;color:{theme.MUTED}'>Landing error of each ball, mm, and the median"
        f" of the last {WINDOW}. At the top: no landing</div>"
    )


SHOW_EVERY_S: Final = 0.25
STARTS_EVERY_S: Final = 2.0
CHART_HEIGHT_PX: Final = 150
LEARN, RESET, SAVE = "Learn while it plays", "Reset learning", "Save as run"
BALL, MEDIAN = "#d9a066", "#ff8c28"
DOTS: Final[uplot.Series_Points] = {"show": True, "size": 4, "stroke": BALL, "fill": BALL}


class LearningPanel:
    """Controls of online learning in one browser. Waiting for the learner happens in the thread pool."""

    def __init__(self, gui: viser.GuiApi, rally: LiveRally, host: ModeHost) -> None:
        self._gui, self._rally, self._host = gui, rally, host
        self._shown_s = self._starts_s = float("-inf")
        self._drawn: tuple[LearningProgress | None, bool] | None = None
        self._chart: viser.GuiUplotHandle | None = None
        learning = rally.learning
        self._folder = gui.add_folder("Learning (shared by all browsers)")
        with self._folder:
            hint = "Each stroke with a known outcome improves the policy"
            self._learn = gui.add_checkbox(LEARN, False, hint=hint, disabled=bool(learning.reason))
            self._start = Listing(gui, "Start from", lambda _: None, hint="Policy to begin with, also after a reset")
            self._start.visible = not learning.reason
            self._status = gui.add_html(reason_html(learning.reason) if learning.reason else "")
            self._room = gui.add_folder(None, visible=False)
            with self._room:
                gui.add_html(chart_title_html())
                self._chart_place = gui.add_folder(None)
                self._reset = gui.add_button(
                    RESET, icon=viser.Icon.RESTORE, hint="Discards the learned policy for all browsers"
                )
                self._save = gui.add_button(
                    SAVE, icon=viser.Icon.DEVICE_FLOPPY, hint="You can choose it as controller later"
                )
        when_changed(self._learn, lambda on: do_in_pool(host, self._begin if on else learning.stop))
        when_clicked(self._reset, lambda: do_in_pool(host, self._begin_anew))
        when_clicked(self._save, lambda: do_in_pool(host, self._save_run))

    def set_visible(self, visible: bool) -> None:
        """Show the controls only while the live rally is watched."""
        self._folder.visible = visible

    def show(self, wall_s: float) -> None:
        """Update the figures, a few times a second."""
        learning = self._rally.learning
        if learning.reason or wall_s - self._shown_s < SHOW_EVERY_S:
            return
        self._shown_s = wall_s
        if wall_s - self._starts_s > STARTS_EVERY_S:
            self._starts_s = wall_s
            do_in_pool(self._host, self._find_starts)
        progress, on = learning.progress, learning.on
        if self._learn.value != on:
            self._learn.value = on
        if (progress, on) == self._drawn:
            return
        self._drawn = progress, on
        self._status.content = learning_html(progress, on=on)
        self._room.visible = progress is not None
        if progress is not None:
            self._draw(progress)

    def _draw(self, progress: LearningProgress) -> None:
        """Draw the chart; it is made with its first curve, as an empty one may never show its ticks."""
        if not progress.balls:
            if self._chart is not None:
                self._chart.remove()
                self._chart = None
            return
        columns = chart_columns(progress)
        numbers = columns[0]
        scales = {
            "x": uplot.Scale(time=False, auto=False, range=(float(numbers[0]) - 1, float(max(20.0, numbers[-1])))),
            "y": log_scale(*RANGE_MM),
        }
        if self._chart is not None:
            self._chart.data, self._chart.scales = columns, scales
            return
        with self._chart_place:
            self._chart = self._gui.add_uplot(
                columns,
                (
                    uplot.Series(label="ball"),
                    uplot.Series(label="error", stroke=BALL, width=0, points=DOTS),
                    uplot.Series(label="median", stroke=MEDIAN, width=2, points={"show": False}),
                ),
                scales=scales,
                axes=(plot_axis("ball"), plot_axis("mm", decades(*RANGE_MM))),
                legend=uplot.Legend(show=False),
                height=CHART_HEIGHT_PX,
            )

    def _begin(self) -> None:
        workspace = self._host.services.workspace
        self._rally.learning.begin(learning_start(workspace, self._chosen_start))

    def _begin_anew(self) -> None:
        workspace = self._host.services.workspace
        self._rally.learning.reset(learning_start(workspace, self._chosen_start))

    def _save_run(self) -> None:
        with self._host.services.trainer.free_name("learned-live") as name:
            self._rally.learning.save(self._host.services.workspace.run_path(name))
        self._host.later(lambda: self._host.note("Saved", f"{name}: choose it as controller", "green"))

    @property
    def _chosen_start(self) -> str:
        """Name of the chosen run, or `NOTHING`."""
        return self._start.chosen or NOTHING

    def _find_starts(self) -> None:
        starts = start_choices(self._host.services.workspace)
        self._host.later(lambda: self._start.offer(starts))
