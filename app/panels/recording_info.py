"""Health of the recording, below the pictures in Watch. Its event rate is in the time line."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
import viser
from numpy.typing import NDArray

from app import theme
from app.formatting import html_text, percent, table_row
from app.shared.library import Library
from app.views.frame_picture import shown_frames
from core.events import Health, RateCurve, rate_curve
from core.recordings import Recording
from core.text import counted

Room = Literal["folded", "narrow", "wide"]
WIDTHS_PX: Final[dict[Room, int]] = {"folded": 280, "narrow": 280, "wide": 350}
"""Width of the open panel. With the controls at the right, 280 px leave 46 % of a 1280 px window to the scene."""
FOLD_BELOW: Final = 0.7
"""Width over height of the middle. A window of 1000x700 with both panels open has 0.4."""
OPEN_ABOVE: Final = 1.25
"""With the panel folded. A window of 1280x720 has 1.2 then."""
WIDE_ABOVE: Final = 1.0
NARROW_BELOW: Final = 0.8
"""A window of 1600x900 has 1.01 beside a narrow panel and 0.94 beside a wide one."""


def room_beside(aspect: float, room: Room) -> Room:
    """Next width class of the panel, from the middle's width over height.

    The bounds lie so far apart that no answer leads back at once. A person who opens a folded panel is not overruled:
    only a middle that became wide unfolds it, and only an unfolded one folds.
    """
    if room == "folded":
        return "narrow" if aspect > OPEN_ABOVE else "folded"
    if aspect < FOLD_BELOW:
        return "folded"
    if room == "narrow":
        return "wide" if aspect > WIDE_ABOVE else "narrow"
    return "narrow" if aspect < NARROW_BELOW else "wide"


class PanelLayout:
    """Docks a panel at the left and adapts its width."""

    def __init__(self, panel: viser.PanelHandle) -> None:
        self._panel = panel
        self._room: Room = "narrow"
        panel.dock_left()
        panel.set_width(WIDTHS_PX[self._room])

    def follow(self, aspect: float) -> None:
        """Adapt the width to the middle's width over height."""
        room = room_beside(aspect, self._room)
        if room == self._room:
            return
        if "folded" in (room, self._room):
            (self._panel.minimize if room == "folded" else self._panel.expand)()
        self._panel.set_width(WIDTHS_PX[room])
        self._room = room


PLOT_BINS = 400
LISTED = 4
HOT_PER_MILLION: Final = 100
"""Hot pixels among a million that are no fault: sensors have 15 in the median (docs/how/sensor-model.md), and detectors
take them out (choice)."""
TIGHT: Final = "font-size:12.5px;line-height:1.25;padding:0 12px;margin-top:-6px"
"""CSS of the table: two cameras and two lines below fit without scrolling."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordingInfo:
    """Rates and health of a recording's streams."""

    name: str
    curves: dict[str, RateCurve]
    health: dict[str, Health]
    pixels: dict[str, int]
    """Count of each camera's pixels."""
    notes: tuple[str, ...]
    frames: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    """Times of the pictures of each ordinary camera, us at mid exposure."""


def gather_info(library: Library, name: str) -> RecordingInfo:
    """Rates and health of every camera (some 0.1 s a camera)."""
    recording: Recording = library.open(name)
    curves = {
        camera: rate_curve(stream.counts_per_ms(), recording.duration_us, bins=PLOT_BINS)
        for camera, stream in recording.cameras.items()
    }
    health = {camera: library.health(name, camera) for camera in recording.cameras}
    pixels = {camera: stream.sensor.width_px * stream.sensor.height_px for camera, stream in recording.cameras.items()}
    frames = {title: np.asarray(one.t_us, np.int64) for title, one in shown_frames(recording).items()}
    return RecordingInfo(name, curves, health, pixels, recording.notes, frames)


class RecordingInfoPanel:
    """A floating panel below the pictures."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self.panel = gui.add_panel()
        with self.panel.add_tab("Health", viser.Icon.HEARTBEAT):
            self._health = gui.add_html("")

    def show_info(self, info: RecordingInfo) -> None:
        """Health of a new recording."""
        self._health.content = health_html(info)


def health_html(info: RecordingInfo) -> str:
    """HTML with a row per camera, then warnings."""
    head = "".join(
        f"<th style='text-align:left;font-weight:500;color:{theme.MUTED};padding:0 14px 0 0'>{title}</th>"
        for title in ("camera", "duration", "events", "mean rate", "peak rate", "ON share", "hot pixels", "gaps")
    )
    rows = "".join(_health_row(name, health) for name, health in info.health.items())
    notes = "".join(f"<div style='color:{theme.MUTED}'>{html_text(note)}</div>" for note in info.notes)
    remarks: list[str] = []
    harmless: list[str] = []
    for name, health in info.health.items():
        if not health.event_count:
            remarks.append(f"{html_text(name)}: no events in the whole recording")
        remarks += [
            f"{html_text(name)}: no events from {gap.start_us / 1e6:.3f} to {gap.end_us / 1e6:.3f} s"
            for gap in health.gaps[:LISTED]
        ]
        pixels = ", ".join(f"({x}, {y})" for x, y in health.hot_pixels_xy[:LISTED])
        count, most = len(health.hot_pixels_xy), harmless_hot_pixels(info.pixels[name])
        if count:
            verdict = f"{counted(count, 'hot pixel')}, {'more than' if count > most else 'harmless up to'} {most}"
            lines = remarks if count > most else harmless
            lines.append(f"{html_text(name)}: {verdict}; busiest {pixels}")
    if info.frames:
        harmless.append(" &middot; ".join(_frames_words(title, t_us) for title, t_us in info.frames.items()))
    listed = "".join(f"<div style='color:{theme.BAD}'>{remark}</div>" for remark in remarks)
    sound = f"<div style='color:{theme.GOOD}'>no problems found</div>"
    notes = "".join(f"<div style='color:{theme.MUTED}'>{line}</div>" for line in harmless) + notes
    return (
        f"<div style='{TIGHT}'>"
        f"<table style='border-spacing:0'><tr>{head}</tr>{rows}</table>"
        f"<div style='margin-top:3px'>{listed or sound}{notes}</div></div>"
    )


def harmless_hot_pixels(pixels: int) -> int:
    """Most hot pixels of a sensor with so many pixels that are no fault; at least one."""
    return max(1, pixels * HOT_PER_MILLION // 1_000_000)


def _frames_words(title: str, t_us: NDArray[np.int64]) -> str:
    """How many pictures an ordinary camera took, how often, and the longest time between two."""
    words = f"{html_text(title)}: {counted(len(t_us), 'picture')}"
    if len(t_us) < 2 or t_us[-1] <= t_us[0]:
        return words
    rate_hz, longest_us = 1e6 * (len(t_us) - 1) / int(t_us[-1] - t_us[0]), int(np.diff(t_us).max())
    return f"{words}, {rate_hz:.1f} per second, at most {longest_us / 1e3:.1f} ms apart"


def _health_row(name: str, health: Health) -> str:
    share = "no events" if np.isnan(health.on_share) else percent(health.on_share)
    cells = (
        html_text(name), f"{health.duration_us / 1e6:.3f} s", f"{health.event_count:,}",
        f"{health.mean_rate_hz / 1e6:.2f} Mev/s", f"{health.peak_rate_hz / 1e6:.2f} Mev/s",
        share, len(health.hot_pixels_xy), len(health.gaps),
    )  # fmt: skip
    return table_row(cells, "padding:0 14px 0 0")
