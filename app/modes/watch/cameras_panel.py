"""Panel to the left of the 3D scene: camera pictures, figures of the rally, prediction errors."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final, Literal

import numpy as np
import viser
from viser import uplot

from app import theme
from app.panels.recording_info import PanelLayout
from app.scene.ball import speed_legend_html
from app.scene.prediction import AFTER_RGB, BEFORE_RGB
from app.views.camera_pictures import CameraPicturesRequest
from app.views.image_view import set_png
from app.widgets import Choice, Listing, plot_axis
from core.history.lead_time import LONGEST_MS, LeadTimeErrors

LEAD_TIME_HTML = (
    f"<div style='font-size:12.5px;color:{theme.MUTED};padding:4px 12px'>Median error of the predicted hit, in the "
    "hitting plane, by how long before it the prediction was made. Needs the truth: simulations know it.</div>"
)
TOP_STEP_MM = 20.0
BLANK = np.zeros((2, 2, 3), np.uint8)
MANY: Final = 3
"""So many pictures stand in rows, two or three beside each other."""
SCENE: Final = "3D"
"""What stands in the middle if no picture does."""
Sighting = Literal["used", "elsewhere", "none", "unknown"]
SIGHTING_MARKS: Final[Mapping[Sighting, str]] = {
    "used": "\u25cf ",
    "elsewhere": "\u2715 ",
    "none": "\u25cb ",
    "unknown": "",
}
"""Before a camera's name: the ball's position is made of it; it found something elsewhere; it found no ball; the chain
has not come there yet."""


def sighting_of(request: CameraPicturesRequest, camera: str) -> Sighting:
    """What a camera contributes to the ball's position."""
    if not request.reached:
        return "unknown"
    if request.is_outlier(camera):
        return "elsewhere"
    return "used" if camera in request.circles else "none"


def rows_html(pictures: int) -> str:
    """Marks the pictures that follow it for the page's style: it lays three or more out in rows, with a legend."""
    if pictures < MANY:
        return "<div data-rallyscope-cameras></div>"
    legend = "&#9679; sees the ball &nbsp; &#10005; something else &nbsp; &#9675; no ball"
    columns = 2 if pictures <= 4 else 3
    style = f"font-size:12px;color:{theme.MUTED};padding:2px 12px"
    return f"<div data-rallyscope-cameras data-rallyscope-columns={columns} style='{style}'>{legend}</div>"


class CamerasPanel:
    """The camera pictures of one browser, as many as the recording has cameras."""

    def __init__(self, gui: viser.GuiApi, enlarge: Callable[[str], None]) -> None:
        self._gui, self._enlarge = gui, enlarge
        self.panel = gui.add_panel(visible=False)
        self._tab = self.panel.add_tab("Rally", viser.Icon.PING_PONG)
        self.room = PanelLayout(self.panel)
        with self._tab:
            self._rows = gui.add_html("")
            self._pictures = gui.add_folder(None)
            gui.add_html(speed_legend_html())
            self._moment = gui.add_html("")
            self._live = gui.add_html("")
        self._top_mm = TOP_STEP_MM
        with self.panel.add_tab("Prediction", viser.Icon.CHART_LINE):
            gui.add_html(LEAD_TIME_HTML)
            nothing = LeadTimeErrors(np.empty(0), np.empty(0), np.empty(0, np.bool_))
            self._lead_times = gui.add_uplot(
                nothing.medians(),
                (
                    uplot.Series(label="lead"),
                    uplot.Series(
                        label="before the bounce",
                        stroke="rgb({},{},{})".format(*BEFORE_RGB),
                        width=2,
                        points={"show": True},
                    ),
                    uplot.Series(
                        label="after it", stroke="rgb({},{},{})".format(*AFTER_RGB), width=2, points={"show": True}
                    ),
                ),
                scales=_scales(self._top_mm),
                axes=(plot_axis("ms before the hit"), plot_axis("mm")),
                aspect=1.2,
            )
        self._larger: Choice | Listing | None = None
        self._images: dict[str, viser.GuiImageHandle] = {}

    def show_large(self, camera: str) -> None:
        """Mark the camera whose picture is in the middle."""
        if self._larger is not None:
            self._larger.show(camera or SCENE)

    def show_lead_times(self, errors: LeadTimeErrors) -> None:
        """Median prediction error by lead time."""
        columns = errors.medians()
        largest = np.nanmax(np.concatenate([columns[1], columns[2], [1.0]]))
        top_mm = TOP_STEP_MM * math.ceil(float(largest) / TOP_STEP_MM)
        if top_mm != self._top_mm:
            self._top_mm = top_mm
            self._lead_times.scales = _scales(top_mm)
        self._lead_times.data = columns

    def show_figures(self, moment_html: str, live_html: str) -> None:
        """Show the figures below the pictures."""
        for handle, content in ((self._moment, moment_html), (self._live, live_html)):
            if handle.content != content:
                handle.content = content

    def _add_larger(self, cameras: tuple[str, ...], *, many: bool) -> Choice | Listing:
        hint = "Show it full size. Again, G, or a double click goes back"
        if not many:
            return Choice(self._gui, "Larger", cameras, self._enlarge, hint=hint)
        larger = Listing(
            self._gui, "Larger", lambda camera: self._enlarge(camera if camera in cameras else ""), hint=hint
        )
        larger.offer((SCENE, *cameras))
        return larger

    def show(self, pngs: Mapping[str, bytes], sightings: Mapping[str, Sighting]) -> None:
        """Put new pictures in place of the last ones; three or more stand in rows, each with a mark of its sighting."""
        if tuple(self._images) != tuple(pngs):
            for image in self._images.values():
                image.remove()
            with self._pictures:
                self._rows.content = rows_html(len(pngs))
                self._images = {name: self._gui.add_image(BLANK, label=name, format="png") for name in pngs}
                if self._larger is not None:
                    self._larger.remove()
                self._larger = self._add_larger(tuple(pngs), many=len(pngs) >= MANY)
        for name, png in pngs.items():
            set_png(self._images[name], png)
            caption = name if len(pngs) < MANY else f"{SIGHTING_MARKS[sightings[name]]}{name}"
            if self._images[name].label != caption:
                self._images[name].label = caption


def _scales(top_mm: float) -> dict[str, uplot.Scale]:
    """Ranges of the axes; the plot finds none by itself in data with gaps."""
    return {"x": {"time": False, "range": (0.0, LONGEST_MS)}, "y": {"range": (0.0, top_mm)}}
