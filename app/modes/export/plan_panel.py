"""What is exported of what, how pictures of the 3D view are made, and what an export is computed with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import viser

from app import theme
from app.export.formats import FORMATS
from app.export.selection import Span, span_of
from app.formatting import html_text
from app.state.client_state import Slot
from app.state.config_words import settings_words
from app.widgets import Choice, Listing, titles_of, when_changed, when_clicked
from core.detection.saved import SavedDetector
from core.errors import CommandError
from core.recordings import Recording

VIEW_PICTURE, VIEW_FILM = "view-png", "view-mp4"
VIEWS: Final = {VIEW_PICTURE: "Picture of the 3D view (.png)", VIEW_FILM: "Film of the 3D view (.mp4)"}
"""Drawn by the browser, so for nobody but the app."""
SIZES: Final = {
    "960 x 540": (960, 540),
    "1280 x 720": (1280, 720),
    "1920 x 1080": (1920, 1080),
    "2560 x 1440": (2560, 1440),
    "3840 x 2160": (3840, 2160),
}
FRAMES_PER_S: Final = {"25": 25.0, "30": 30.0, "50": 50.0, "60": 60.0}
SPEEDS: Final = {"1": 1.0, "1/2": 0.5, "1/4": 0.25, "1/8": 0.125, "1/16": 0.0625, "1/32": 0.03125}


@dataclass(frozen=True, slots=True)
class ViewChoices:
    """Size, view and length of a picture or film of the 3D view."""

    width_px: int
    height_px: int
    frames_per_s: float
    speed: float
    """Recording seconds for each second of the film."""


class ViewOptions:
    """These controls of one browser."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._folder = gui.add_folder("Of the 3D view", visible=False)
        with self._folder:
            gui.add_html(
                "<div style='font-size:12.5px;padding:2px 12px'>Your browser renders the current view. Turn "
                "the view first, and keep this window in front while a film is made.</div>"
            )
            self._size = gui.add_dropdown("Size", tuple(SIZES), initial_value="1280 x 720")
            self._rate = gui.add_dropdown("Frames a second", tuple(FRAMES_PER_S))
            self._speed = gui.add_dropdown("Film speed", tuple(SPEEDS), initial_value="1/4", hint="1 is real time")

    def show(self, chosen: str) -> None:
        """Show what counts for the chosen format; nothing for those of other kinds."""
        self._folder.visible = chosen in VIEWS
        self._rate.visible = self._speed.visible = chosen == VIEW_FILM

    @property
    def choices(self) -> ViewChoices:
        """The current choices, checked: a browser may send anything."""
        width, height = SIZES.get(str(self._size.value), (1280, 720))
        rate = FRAMES_PER_S.get(str(self._rate.value), 25.0)
        return ViewChoices(width, height, rate, SPEEDS.get(str(self._speed.value), 0.25))


What = Literal["Recording", "Training run"]
WHATS: Final[tuple[What, ...]] = ("Recording", "Training run")
ALL, ROUND = "Everything", "2 s here"
ROUND_US: Final = 2_000_000
STRIDES_US: Final = {"2 ms": 2000, "4 ms": 4000, "10 ms": 10_000, "20 ms": 20_000, "40 ms": 40_000}
NOBODY: Final = "nobody"
UNCHOSEN: Final = "choose an annotator"
"""Option of the list of annotators while it is not known whose labels are meant."""


def usual_annotator(annotators: tuple[str, ...], signed_in: str | None) -> str:
    """Whose labels are exported unless somebody chooses: the signed-in annotator's, else those of the only one.

    `UNCHOSEN` if there are several and none of them is signed in, `NOBODY` if there are no labels.
    """
    if signed_in in annotators:
        return str(signed_in)
    return UNCHOSEN if len(annotators) > 1 else annotators[0] if annotators else NOBODY


class AnnotatorQuestion:
    """A window that asks whose labels go into the file."""

    def __init__(self, gui: viser.GuiApi, annotators: tuple[str, ...], chosen: Callable[[str | None], None]) -> None:
        """`chosen` is called once, from viser's loop, with a name, `NOBODY`, or None for "not now"."""
        self._modal = gui.add_modal("Whose labels?")
        self._chosen = chosen
        with self._modal:
            gui.add_markdown("Several annotators have labelled this recording. The file shows the labels of one.")
            self._name = gui.add_dropdown("Labels of", (*annotators, NOBODY))
            go = gui.add_button("Export", icon=viser.Icon.CHECK, color="teal")
            no = gui.add_button("Not now")
        when_clicked(go, lambda: self._end(str(self._name.value)))
        when_clicked(no, lambda: self._end(None))

    def _end(self, name: str | None) -> None:
        self._modal.close()
        self._chosen(name)


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
    asks_annotator: bool
    """Whether it is to be asked whose labels are meant: several have labelled, and none of them is signed in."""
    view: ViewChoices

    @property
    def of_view(self) -> bool:
        """It is drawn by the browser."""
        return self.what == "Recording" and self.format in VIEWS

    @property
    def kind(self) -> str:
        """What is made: the format, or a training run's file."""
        return self.format if self.what == "Recording" else self.what


class ExportPlanPanel:
    """What one browser wants to export, and how."""

    def __init__(self, gui: viser.GuiApi, here_us: Callable[[], int], later: Callable[[Callable[[], None]], None]):
        self._what: What = "Recording"
        self._annotator_chosen = False
        """Whether a person has chosen whose labels are exported."""
        self._span_us = (0, 0)
        self._here_us = here_us
        self._choice = Choice(gui, "What", WHATS, lambda what: later(lambda: self._choose(what)))
        self._run = Listing(gui, "Run", lambda _: None, hint="Trainings of the workspace")
        self._titles = {
            **titles_of({name: kind.label for name, kind in FORMATS.items() if kind.of_recordings}),
            **VIEWS,
        }
        self._title = gui.add_dropdown("Format", tuple(self._titles.values()))
        self._range = gui.add_folder("Part")
        with self._range:
            self._start = gui.add_number("From [s]", 0.0, min=0.0, step=0.001)
            self._end = gui.add_number("To [s]", 0.0, min=0.0, step=0.001)
            self._part = gui.add_button_group(
                "Take", (ALL, ROUND), hint="The whole recording, or 2 s with the cursor in the middle, or near an end"
            )
        self._view = ViewOptions(gui)
        self._contents = gui.add_folder("In the Rerun file", expand_by_default=False)
        with self._contents:
            self._pictures = gui.add_checkbox("Pictures", True, hint="Pictures of each camera")
            self._stages = gui.add_checkbox(
                "Stages", True, hint="Stages of the detector: denoised, clusters, hulls, ROI"
            )
            self._plots = gui.add_checkbox("Curves", True, hint="Event rates, latencies, errors")
            self._stride = gui.add_dropdown(
                "Every", tuple(STRIDES_US), initial_value="4 ms", hint="Time between two pictures"
            )
            self._annotator = Listing(
                gui,
                "Labels of",
                lambda name: later(lambda: self.choose_annotator(name)),
                hint="Whose labels are shown on the pictures",
            )
        when_changed(self._title, lambda _: later(self._show_what_counts))

        @self._part.on_click
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
            annotator=None if annotator in (NOBODY, UNCHOSEN) else annotator,
            asks_annotator=annotator == UNCHOSEN,
            view=self._view.choices,
        )

    def offer(self, runs: tuple[str, ...], annotators: tuple[str, ...], signed_in: str | None) -> None:
        """Offer these runs and annotators; whose labels are exported follows `usual_annotator` until one is chosen."""
        self._run.offer(runs)
        if self._annotator.chosen not in (NOBODY, *annotators):
            self._annotator_chosen = False  # a choice for another recording
        usual = usual_annotator(annotators, signed_in)
        asks = not self._annotator_chosen and usual == UNCHOSEN
        self._annotator.offer((UNCHOSEN, NOBODY, *annotators) if asks else (NOBODY, *annotators))
        if not self._annotator_chosen:
            self._annotator.show(usual)

    def choose_annotator(self, name: str) -> None:
        """Export this annotator's labels, or those of `NOBODY`."""
        self._annotator_chosen = name != UNCHOSEN
        self._annotator.show(name)

    def use_span(self, start_us: int, end_us: int) -> None:
        """Another recording, or more of it: offer all of it."""
        self._start.value, self._end.value = start_us / 1e6, end_us / 1e6
        self._span_us = start_us, end_us
        self._part.options = parts_of(self._span_us)

    def _take(self, part: str) -> None:
        start_us, end_us = part_around(self._here_us(), self._span_us) if part == ROUND else self._span_us
        self._start.value, self._end.value = start_us / 1e6, end_us / 1e6

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


def parts_of(span_us: tuple[int, int]) -> tuple[str, ...]:
    """What can be taken of a recording: 2 s only of a longer one."""
    first_us, last_us = span_us
    return (ALL, ROUND) if last_us - first_us > ROUND_US else (ALL,)


def part_of(recording: Recording, plan: ExportPlan) -> Span:
    """The part of a recording that a person chose; all of it for a picture of the 3D view, which asks for none.

    Raises:
        CommandError: in the words of the panel, if there is no such part.
    """
    if plan.format == VIEW_PICTURE:
        return span_of(recording)
    if recording.duration_us > 0 and not 0 <= plan.start_us < min(plan.end_us, recording.duration_us):
        raise CommandError(
            "no such part of the recording",
            expected=f"From before To, and before its end at {recording.duration_us / 1e6:g} s",
            got=f"{plan.start_us / 1e6:g} to {plan.end_us / 1e6:g} s",
            where="Part",
        )
    return span_of(recording, plan.start_us, plan.end_us)


def part_around(here_us: int, span_us: tuple[int, int]) -> tuple[int, int]:
    """[start, end) of 2 s round a time, shifted to lie inside of the span; all of a shorter one."""
    first_us, last_us = span_us
    start_us = max(min(here_us - ROUND_US // 2, last_us - ROUND_US), first_us)
    return start_us, min(start_us + ROUND_US, last_us)


def made_with_html(plan: ExportPlan, detector: SavedDetector, slot: Slot, annotators: tuple[str, ...]) -> str:
    """Lines about an export of a recording; empty for a training run and for what the browser draws.

    Args:
        plan: what is exported.
        detector: method and config that Tune shows.
        slot: which of Tune's configs that is.
        annotators: who has labelled the recording.
    """
    if plan.what != "Recording" or plan.of_view:
        return ""
    computed = FORMATS[plan.format].computed
    lines = [detector_text(detector, slot) if computed else "Needs no detector: written as recorded."]
    left_out = labels_left_out(plan, annotators)
    if plan.asks_annotator and plan.format == "rrd":
        lines.append(f"Several annotators: {html_text(', '.join(annotators))}. You are asked whose labels are meant.")
    elif left_out:
        why = (
            "a file has those of one annotator, chosen in Labels of"
            if plan.format == "rrd"
            else "only a Rerun file has labels. Label downloads them alone"
        )
        lines.append(f"Left out: the labels of {html_text(', '.join(left_out))}; {why}.")
    return f"<div style='padding:2px 1em;font-size:12.5px;color:{theme.MUTED}'>{'<br>'.join(lines)}</div>"


def detector_text(detector: SavedDetector, slot: Slot) -> str:
    """Which settings detections and predictions are made with."""
    settings = html_text(settings_words(detector.method, detector.config))
    return f"Uses Tune's config {slot}: method {html_text(detector.method)}, {settings}."


def labels_left_out(plan: ExportPlan, annotators: tuple[str, ...]) -> tuple[str, ...]:
    """The annotators whose labels are not in the file: only a Rerun file has labels, and those of one."""
    return tuple(name for name in annotators if plan.format != "rrd" or name != plan.annotator)
