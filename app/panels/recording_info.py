"""Below the pictures in Watch: the event rate over the recording, and whether it is sound."""

from __future__ import annotations

import html
from dataclasses import dataclass

import numpy as np
import viser
from viser import uplot

from app import theme
from app.shared.library import Library
from core.events import Health, RateCurve, rate_curve
from core.recordings import Recording

PLOT_BINS = 400
CAMERA_COLOURS = ("#ff8c28", "#5096ff", "#6eeb82", "#e6a0ff")
LISTED = 4


@dataclass(frozen=True, slots=True, eq=False)
class RecordingInfo:
    """What is known of a recording's streams."""

    name: str
    curves: dict[str, RateCurve]
    health: dict[str, Health]
    notes: tuple[str, ...]


def gather_info(library: Library, name: str) -> RecordingInfo:
    """Rates and health of every camera (some 0.1 s a camera)."""
    recording: Recording = library.open(name)
    curves = {
        camera: rate_curve(stream.counts_per_ms(), bins=PLOT_BINS) for camera, stream in recording.cameras.items()
    }
    health = {camera: library.health(name, camera) for camera in recording.cameras}
    return RecordingInfo(name, curves, health, recording.notes)


class RecordingInfoPanel:
    """A floating panel below the pictures."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui = gui
        self.panel = gui.add_panel()
        self._rate_tab = self.panel.add_tab("Event rate", viser.Icon.CHART_LINE)
        with self.panel.add_tab("Health", viser.Icon.HEARTBEAT):
            self._health = gui.add_html("")
        self._plot: viser.GuiUplotHandle | None = None
        self._info: RecordingInfo | None = None
        self._marked_bin = -1

    def show_info(self, info: RecordingInfo) -> None:
        """A new recording's curves and health."""
        self._info = info
        self._marked_bin = -1
        if self._plot is not None:
            self._plot.remove()
            self._plot = None
        self._health.content = health_html(info)
        if any(len(curve.t_s) > 1 for curve in info.curves.values()):
            with self._rate_tab:
                self._plot = self._gui.add_uplot(
                    _plot_data(info, -1),
                    _plot_series(tuple(info.curves)),
                    height=130,
                    scales={"x": {"time": False}, "y": {"range": (0.0, _top(info))}},
                    axes=(plot_axis("s"), plot_axis("Mev/s")),
                    legend={"show": False},
                )

    def show_time(self, now_us: int) -> None:
        """Mark the current time in the plot."""
        if self._plot is None or self._info is None:
            return
        t_s = next(iter(self._info.curves.values())).t_s
        here = int(np.clip(np.searchsorted(t_s, now_us / 1e6), 0, len(t_s) - 1))
        if here != self._marked_bin:
            self._marked_bin = here
            self._plot.data = _plot_data(self._info, here)


def health_html(info: RecordingInfo) -> str:
    """One row a camera, then what stands out."""
    head = "".join(
        f"<th style='text-align:left;font-weight:500;color:{theme.MUTED};padding-right:14px'>{title}</th>"
        for title in ("camera", "duration", "events", "mean rate", "peak rate", "ON share", "hot pixels", "gaps")
    )
    rows = "".join(_health_row(name, health) for name, health in info.health.items())
    remarks = [html.escape(note) for note in info.notes]
    for name, health in info.health.items():
        remarks += [
            f"{html.escape(name)}: no events from {gap.start_us / 1e6:.3f} to {gap.end_us / 1e6:.3f} s"
            for gap in health.gaps[:LISTED]
        ]
        pixels = ", ".join(f"({x}, {y})" for x, y in health.hot_pixels_xy[:LISTED])
        if pixels:
            remarks.append(f"{html.escape(name)}: busiest hot pixels {pixels}")
    listed = "".join(f"<div style='color:{theme.BAD}'>{remark}</div>" for remark in remarks)
    sound = f"<div style='color:{theme.GOOD}'>nothing stands out</div>"
    return (
        f"<div style='font-size:12.5px;padding:6px 12px'><table><tr>{head}</tr>{rows}</table>"
        f"<div style='margin-top:6px'>{listed or sound}</div></div>"
    )


def _health_row(name: str, health: Health) -> str:
    share = "-" if np.isnan(health.on_share) else f"{health.on_share:.0%}"
    cells = (
        html.escape(name), f"{health.duration_us / 1e6:.3f} s", f"{health.event_count:,}",
        f"{health.mean_rate_hz / 1e6:.2f} Mev/s", f"{health.peak_rate_hz / 1e6:.2f} Mev/s",
        share, len(health.hot_pixels_xy), len(health.gaps),
    )  # fmt: skip
    return "<tr>" + "".join(f"<td style='padding-right:14px'>{cell}</td>" for cell in cells) + "</tr>"


def _plot_data(info: RecordingInfo, marked_bin: int) -> tuple[np.ndarray, ...]:
    curves = tuple(info.curves.values())
    longest = max(curves, key=lambda curve: len(curve.t_s))
    columns = [np.pad(curve.rate_hz / 1e6, (0, len(longest.t_s) - len(curve.rate_hz))) for curve in curves]
    marker = np.full(len(longest.t_s), np.nan)
    if marked_bin >= 0:
        marker[marked_bin] = max(column[marked_bin] for column in columns)
    return (longest.t_s, *columns, marker)


def _top(info: RecordingInfo) -> float:
    """Upper end of the plot, fixed so that the marker does not rescale it."""
    return 1.1 * max(1e-6, *(float(curve.rate_hz.max(initial=0.0)) / 1e6 for curve in info.curves.values()))


def _plot_series(cameras: tuple[str, ...]) -> tuple[uplot.Series, ...]:
    lines = [
        uplot.Series(label=name, stroke=CAMERA_COLOURS[number % len(CAMERA_COLOURS)], width=1.5)
        for number, name in enumerate(cameras)
    ]
    now = uplot.Series(label="now", stroke="#ffffff", points={"show": True, "size": 9, "fill": "#ffffff"})
    return (uplot.Series(label="s"), *lines, now)


def plot_axis(unit: str) -> uplot.Axis:
    """An axis with its unit, in the colours of the app."""
    return uplot.Axis(label=unit, stroke=theme.MUTED, grid={"stroke": "#333640"}, labelSize=16, size=38)
