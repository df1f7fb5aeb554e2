"""The panel at the left of the scene in Train: curves, landings, the map, the list of runs, the log."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from app import theme
from app.formatting import html_text
from app.modes.train.curves import WINDOW, SeedResults, border_lines, seed_results_html, stage_labels
from app.modes.train.maps import MapView
from app.modes.train.status import case_counts_html, kept_html, log_html, map_html, offsets_title_html, runs_html
from app.modes.train.view import COMPARED, ChartData, Details, RunsView
from app.panels.recording_info import PanelLayout
from app.views.image_view import set_png
from app.widgets import curve_axis, decades, log_scale

Array = NDArray[np.float64]
CHART_HEIGHT_PX: Final = 110
STAGES_PX: Final = 13
"""Height of the line of speeds above a chart."""
OURS: Final = "#ff8c28"
EVALUATED: Final = "#ffffff"
MEAN: Final = "#ffd0a0"
SEED: Final = "#d98f4e"
BAND: Final = "rgba(255,208,160,0.22)"
BAND_EDGE: Final = "rgba(255,208,160,0.35)"
OTHERS: Final = ("#5aa9ff", "#b98cff", "#4fd1c5")
NOISE: Final = "#ffd60a"
W1: Final = "#5aa9ff"
W2: Final = "#6eeb82"
ERROR_TOPS_MM: Final = (100.0, 1_000.0, 10_000.0)
"""Possible ends of the error's scale: its labels are the powers of ten."""
LEAST_ERROR_MM: Final = 10.0
"""Lower end of the error's scale, which is logarithmic: what is learned last is a factor, not a distance."""
WEIGHTS: Final = "weights"
OUT_OF_FOCUS: Final = 0.55
"""Opacity of the other lines while the mouse is at one."""
BORDER_SPANS: Final = {
    "returned": (0.0, 104.0),
    "error_mm": (LEAST_ERROR_MM, ERROR_TOPS_MM[-1]),
    "reward": (-1.1, 4.1),
    WEIGHTS: (0.0, 1.02),
}
"""Lower and upper end of the line where a stage begins: of the chart's largest scale."""
TITLES: Final = (
    ("returned", f"Returned, % of the last {WINDOW} balls"),
    ("error_mm", f"Landing error, mm (log), mean of the last {WINDOW}"),
    ("reward", f"Reward, mean of the last {WINDOW}"),
)


class ChartsPanel:
    """Charts, made with the first curves: an empty chart may never show its ticks. Later only data is sent,
    and a scale when it has to grow.
    """

    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui = gui
        self._legend = gui.add_html(_title("Curves come with the first balls of a training."))
        self._place = gui.add_folder(None, visible=False)
        self._kept = gui.add_html("")
        self._results = gui.add_html("")
        self._titles: list[viser.GuiHtmlHandle] = []
        self._charts: dict[str, viser.GuiUplotHandle] = {}
        self._seeds: tuple[int, ...] = ()
        """Seeds that have a line in the charts beside the newest."""

    def show(
        self,
        run: str,
        data: ChartData,
        compared: tuple[str, ...],
        *,
        several_seeds: bool,
        results: SeedResults | None = None,
        kept: str = "",
    ) -> None:
        """Draw new curves; `results` of the seeds if there are several, and as HTML what each stage kept."""
        self._kept.content = kept
        self._legend.content = curve_legend_html(run, compared, several_seeds=several_seeds)
        self._results.content = seed_results_html(results)
        columns = chart_columns(data)
        if tuple(data.seeds) != self._seeds and self._charts:  # a chart has fixed curves
            for part in (*self._titles, *self._charts.values()):
                part.remove()
            self._titles, self._charts = [], {}
        self._seeds = tuple(data.seeds)
        if not self._charts:
            self._add_charts(data, columns)
            return
        for name, chart in self._charts.items():
            chart.data = (data.axis, *columns[name])
            y_range = _range_of(name, columns[name])
            scales, axes = _scales(data.end, name, y_range), _axes(name, y_range, data.stages, data.end)
            if (scales, axes) != (chart.scales, chart.axes):
                chart.scales, chart.axes = scales, axes

    def _add_charts(self, data: ChartData, columns: dict[str, list[Array]]) -> None:
        self._place.visible = True
        with self._place:
            for name, title in TITLES:
                self._titles.append(self._gui.add_html(_title(title)))
                self._charts[name] = _add_chart(self._gui, name, _curve_series(self._seeds), data, columns[name])
            self._titles.append(self._gui.add_html(_weights_title()))
            self._charts[WEIGHTS] = _add_chart(self._gui, WEIGHTS, _weights_series(), data, columns[WEIGHTS])


def chart_columns(data: ChartData) -> dict[str, list[Array]]:
    """Name of a chart -> its curves, in the order of its series; the chosen run is drawn last, over the others."""
    nothing = np.full(len(data.axis), np.nan)
    columns = {
        name: [
            data.seeds_high[name],
            data.seeds_low[name],
            border_lines(data.axis, data.borders, *BORDER_SPANS[name]),
            *(other[name] for other in data.compared),
            *(seed[name] for seed in data.seeds.values()),
            data.seeds_mean[name],
            data.run[name],
            data.evaluated.get(name, nothing),
        ]
        for name, _ in TITLES
    }
    weights = [data.run[name] for name in ("w1", "w2", "noise")]
    return columns | {WEIGHTS: [border_lines(data.axis, data.borders, *BORDER_SPANS[WEIGHTS]), *weights]}


def curve_legend_html(run: str, compared: tuple[str, ...], *, several_seeds: bool) -> str:
    """HTML legend of the runs' colours, and what is drawn across: charts of this width have no room for axis titles."""
    entries = [(OURS, run), (EVALUATED, "fixed balls, no noise")]
    if several_seeds:
        entries += [(MEAN, "mean of its seeds, 95 % interval (t)"), (SEED, "every seed: mouse over a chart")]
    entries += list(zip(OTHERS, compared, strict=False))
    entries.append((theme.MUTED, "a stage begins"))
    shown = " &nbsp; ".join(
        f"<span style='white-space:nowrap'><span style='color:{colour}'>●</span> {html_text(name)}</span>"
        for colour, name in entries
    )
    across = f"<div style='color:{theme.MUTED}'>Across: balls of the training</div>"
    return f"<div style='font-size:12.5px;padding:6px 12px 0'>{shown}{across}</div>"


def _range_of(name: str, curves: list[Array]) -> tuple[float, float]:
    if name != "error_mm":
        return BORDER_SPANS[name]
    highest = 0.0
    for curve in curves[3:]:  # neither the wide interval of few seeds nor a border sets the scale
        known = curve[np.isfinite(curve)]
        highest = max(highest, float(known.max()) if len(known) else 0.0)
    return LEAST_ERROR_MM, next((top for top in ERROR_TOPS_MM if highest <= top), ERROR_TOPS_MM[-1])


def _scales(end: int, name: str, y_range: tuple[float, float]) -> dict[str, uplot.Scale]:
    if name == "error_mm":
        return {
            "x": uplot.Scale(time=False, auto=False, range=(0.0, float(end))),
            "y": log_scale(*y_range),
        }
    return {
        "x": uplot.Scale(time=False, auto=False, range=(0.0, float(end))),
        "y": uplot.Scale(auto=False, range=y_range),
    }


def _add_chart(
    gui: viser.GuiApi, name: str, series: tuple[uplot.Series, ...], data: ChartData, curves: list[Array]
) -> viser.GuiUplotHandle:
    y_range = _range_of(name, curves)
    return gui.add_uplot(
        (data.axis, *curves),
        series,
        scales=_scales(data.end, name, y_range),
        axes=_axes(name, y_range, data.stages, data.end),
        focus={"alpha": OUT_OF_FOCUS},
        cursor={"points": {"show": False}},  # one of a curve without a value would lie at the chart's corner
        bands=({"series": (1, 2), "fill": BAND},) if name != WEIGHTS else None,
        legend=uplot.Legend(show=False),
        height=CHART_HEIGHT_PX,
        padding=(2, 14, 0, 2),
    )


def _axes(
    name: str, y_range: tuple[float, float], stages: tuple[tuple[float, float], ...], end: int
) -> tuple[uplot.Axis, ...]:
    """Axes of a chart: the logarithmic one has a line at each power of ten in its scale; above, the stages' speeds."""
    y = curve_axis(46)  # as wide as the "10,000" of an error in mm
    if name == "error_mm":
        y["splits"] = decades(*y_range)
    above = curve_axis(STAGES_PX)
    above |= {"scale": "x", "side": 0, "align": 1, "gap": 1, "grid": {"show": False}, "ticks": {"show": False}}
    above["splits"] = tuple(start for start, _ in stages)
    above["values"] = stage_labels(stages, end)
    return curve_axis(22), y, above


_BORDER_SERIES: Final = uplot.Series(label="stage", stroke=theme.MUTED, width=1, dash=(3, 3), points={"show": False})


def _curve_series(seeds: tuple[int, ...]) -> tuple[uplot.Series, ...]:
    """Series of a chart; the seeds' lines are hidden: `charts.js` shows them while the mouse is over the chart."""
    others = [
        uplot.Series(label=f"other {k + 1}", stroke=colour, width=1, points={"show": False})
        for k, colour in enumerate(OTHERS[:COMPARED])
    ]
    return (
        uplot.Series(label="ball"),
        uplot.Series(label="upper end of 95 %", stroke=BAND_EDGE, width=1, points={"show": False}),
        uplot.Series(label="lower end of 95 %", stroke=BAND_EDGE, width=1, points={"show": False}),
        _BORDER_SERIES,
        *others,
        *(uplot.Series(label=f"seed {n}", stroke=SEED, width=1, show=False, points={"show": False}) for n in seeds),
        uplot.Series(label="mean of seeds", stroke=MEAN, width=1, dash=(4, 4), points={"show": False}),
        uplot.Series(label="this run", stroke=OURS, width=2, points={"show": False}),
        uplot.Series(
            label="fixed balls",
            stroke=EVALUATED,
            width=0,
            points={"show": True, "size": 5, "stroke": EVALUATED, "fill": EVALUATED},
        ),
    )


def _weights_series() -> tuple[uplot.Series, ...]:
    return (
        uplot.Series(label="ball"),
        _BORDER_SERIES,
        uplot.Series(label="w1", stroke=W1, width=2, points={"show": False}),
        uplot.Series(label="w2", stroke=W2, width=2, points={"show": False}),
        uplot.Series(label="noise", stroke=NOISE, width=2, points={"show": False}),
    )


def _title(text: str) -> str:
    return f"<div style='font-size:12px;padding:0 12px;margin-bottom:-4px;color:{theme.MUTED}'>{text}</div>"


def _weights_title() -> str:
    parts = (
        (W1, "weight: return"),
        (W2, "weight: place"),
        (NOISE, "exploration noise"),
    )
    return _title(" &nbsp; ".join(f"<span style='color:{colour}'>{text}</span>" for colour, text in parts))


FIRST_PIXELS: Final = np.zeros((1, 1, 3), np.uint8)


class SidePanel:
    """Panel at the left of the scene in Train, for one browser."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._panel = gui.add_panel(visible=False)
        with self._panel.add_tab("Curves"):
            self._charts = ChartsPanel(gui)
        with self._panel.add_tab("Landings"):
            self._plan = gui.add_image(FIRST_PIXELS, format="png")
            self._counts = gui.add_html("")
            gui.add_html(offsets_title_html())
            self._offsets = gui.add_image(FIRST_PIXELS, format="png")
        with self._panel.add_tab("Map"):
            self._map = gui.add_image(FIRST_PIXELS, format="png", visible=False)
            self._before_words = gui.add_html("")
            self._before = gui.add_image(FIRST_PIXELS, format="png", visible=False)
            self._map_words = gui.add_html("")
        with self._panel.add_tab("Runs"):
            self._runs = gui.add_html("")
        with self._panel.add_tab("Log"):
            self._log = gui.add_html("")
        self.room = PanelLayout(self._panel)

    def set_visible(self, visible: bool) -> None:
        """Show it or hide it."""
        self._panel.visible = visible

    def show_map(self, view: MapView) -> None:
        """Show a policy map, and below it that of the policy before the training."""
        for image, png in ((self._map, view.png), (self._before, view.before_png)):
            image.visible = png is not None
            if png is not None:
                set_png(image, png)
        self._map_words.content = map_html(view.words)
        self._before_words.content = map_html(view.before_words)

    def show(self, view: RunsView, details: Details | None) -> None:
        """Update from the runs; pictures are redrawn only when the view has changed."""
        self._runs.content = runs_html(view.runs, view.results)
        self._log.content = log_html(view.log, details)
        if view.run is None or view.details is None:
            return
        new = view.details
        several = view.run.config.seeds > 1
        self._charts.show(
            view.run.name,
            new.charts,
            view.compared,
            several_seeds=several,
            results=new.seed_results,
            kept=kept_html(new.stage_starts, view.run.config.curriculum),
        )
        set_png(self._plan, new.plan_png)
        set_png(self._offsets, new.offsets_png)
        self._counts.content = case_counts_html(new.counts)
