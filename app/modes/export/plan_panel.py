"""What to export: of what, which part, in which format, with what in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import viser

from app.export.formats import FORMATS
from app.modes.export.view_options import VIEW_PICTURE, VIEWS, ViewChoices, ViewOptions
from app.widgets import Choice, Listing, when_changed

What = Literal["Recording", "Training run"]
WHATS: Final[tuple[What, ...]] = ("Recording", "Training run")
ALL, ROUND = "Everything", "2 s here"
ROUND_US: Final = 1_000_000
STRIDES_US: Final = {"2 ms": 2000, "4 ms": 4000, "10 ms": 10_000, "20 ms": 20_000, "40 ms": 40_000}
NOBODY: Final = "nobody"
TITLES: Final = {
    "rrd": "Rerun (.rrd)",
    "html": "3D scene as a web page (.html)",
    "viser": "3D scene for viser (.viser)",
    "mp4": "Film with both cameras, drawn here (.mp4)",
    "png": "Picture with both cameras, of the end (.png)",
    "dsec": "DSEC (HDF5 per camera)",
    "evt3": "Prophesee RAW (EVT3)",
    "mcap": "MCAP for Foxglove (.mcap)",
    "rosbag": "ROS 2 bag of the events",
    "csv": "CSV tables",
}


@dataclass(frozen=True, slots=True)
class ExportPlan:
    """What a person chose."""

    what: What
    run: str | None
    format: str
    start_us: int
    end_us: int
    stride_us: int
    pictures: bool
    stages: bool
    plots: bool
    annotator: str | None
    view: ViewChoices

    @property
    def of_view(self) -> bool:
        """It is drawn by the browser."""
        return self.what == "Recording" and self.format in VIEWS


class ExportPlanPanel:
    """What one browser wants to export, and how."""

    def __init__(self, gui: viser.GuiApi, here_us: Callable[[], int], later: Callable[[Callable[[], None]], None]):
        self._what: What = "Recording"
        self._annotators: tuple[str, ...] = ()
        self._duration_us = 0
        self._here_us = here_us
        self._choice = Choice(gui, "What", WHATS, lambda what: later(lambda: self._choose(what)))
        self._run = Listing(gui, "Run", lambda _: None, hint="Trainings of the workspace")
        self._titles = {**{name: TITLES[name] for name in FORMATS if name in TITLES}, **VIEWS}
        self._title = gui.add_dropdown("Format", tuple(self._titles.values()))
        self._range = gui.add_folder("Part")
        with self._range:
            self._start = gui.add_number("From [s]", 0.0, min=0.0, step=0.001)
            self._end = gui.add_number("To [s]", 0.0, min=0.0, step=0.001)
            part = gui.add_button_group("Take", (ALL, ROUND), hint="All of it, or a second each side of the cursor")
        self._view = ViewOptions(gui)
        self._contents = gui.add_folder("In the Rerun file", expand_by_default=False)
        with self._contents:
            self._pictures = gui.add_checkbox("Pictures", True, hint="What each camera saw")
            self._stages = gui.add_checkbox(
                "Stages", True, hint="What the detector saw: denoised, clusters, hulls, ROI"
            )
            self._plots = gui.add_checkbox("Curves", True, hint="Event rates, latencies, errors")
            self._stride = gui.add_dropdown(
                "Every", tuple(STRIDES_US), initial_value="4 ms", hint="Time between two pictures"
            )
            self._annotator = Listing(gui, "Labels of", lambda _: None, hint="Whose labels are shown on the pictures")
        when_changed(self._title, lambda _: later(self._show_what_counts))

        @part.on_click
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                chosen = str(event.target.value)
                later(lambda: self._take(chosen))

        self._choose("Recording")

    @property
    def plan(self) -> ExportPlan:
        """The plan as it is chosen now."""
        title = str(self._title.value)
        name = next((name for name, text in self._titles.items() if text == title), "rrd")
        annotator = self._annotator.chosen
        return ExportPlan(
            what=self._what,
            run=self._run.chosen,
            format=name,
            start_us=round(1e6 * float(self._start.value)),
            end_us=round(1e6 * float(self._end.value)),
            stride_us=STRIDES_US.get(str(self._stride.value), STRIDES_US["4 ms"]),
            pictures=bool(self._pictures.value),
            stages=bool(self._stages.value),
            plots=bool(self._plots.value),
            annotator=None if annotator == NOBODY else annotator,
            view=self._view.choices,
        )

    def offer(self, runs: tuple[str, ...], annotators: tuple[str, ...]) -> None:
        """What there is to choose from now."""
        self._run.offer(runs)
        self._annotator.offer((NOBODY, *annotators))
        if annotators and not self._annotators:
            self._annotator.show(annotators[0])  # labels that are there are wanted, until somebody says otherwise
        self._annotators = annotators

    def use_span(self, start_us: int, end_us: int) -> None:
        """Another recording, or more of it: offer all of it."""
        self._start.value, self._end.value = start_us / 1e6, end_us / 1e6
        self._duration_us = end_us

    def _take(self, part: str) -> None:
        if part == ROUND:
            here = self._here_us()
            self._start.value = max(0, here - ROUND_US) / 1e6
            self._end.value = min(self._duration_us, here + ROUND_US) / 1e6
        else:
            self._start.value, self._end.value = 0.0, self._duration_us / 1e6

    def _choose(self, what: str) -> None:
        self._what = "Training run" if what == "Training run" else "Recording"
        self._choice.show(self._what)
        self._show_what_counts()

    def _show_what_counts(self) -> None:
        of_run = self._what == "Training run"
        self._run.visible = of_run
        plan = self.plan
        self._title.visible = not of_run
        self._range.visible = not of_run and plan.format != VIEW_PICTURE
        self._contents.visible = not of_run and plan.format == "rrd"
        self._view.show(plan.format if plan.of_view else "")
