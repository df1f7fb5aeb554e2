"""The cameras' live pictures and the rally in figures, docked to the left of the 3D scene."""

from __future__ import annotations

import numpy as np
import viser

from app.plane import set_png

WIDTH_PX = 310
BLANK = np.zeros((2, 2, 3), np.uint8)


class CamerasPanel:
    """Of one browser; it has as many pictures as the recording has cameras."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui = gui
        self.panel = gui.add_panel(visible=False)
        self._tab = self.panel.add_tab("Rally", viser.Icon.PING_PONG)
        self.panel.dock_left()
        self.panel.set_width(WIDTH_PX)
        with self._tab:
            self._pictures = gui.add_folder(None)
            self._moment = gui.add_html("")
            self._live = gui.add_html("")
        self._images: dict[str, viser.GuiImageHandle] = {}

    def show_figures(self, moment_html: str, live_html: str) -> None:
        """What stands below the pictures."""
        self._moment.content, self._live.content = moment_html, live_html

    def show(self, pngs: dict[str, bytes]) -> None:
        """New pictures."""
        if tuple(self._images) != tuple(pngs):
            for image in self._images.values():
                image.remove()
            with self._pictures:
                self._images = {name: self._gui.add_image(BLANK, label=name, format="png") for name in pngs}
        for name, png in pngs.items():
            set_png(self._images[name], png)
