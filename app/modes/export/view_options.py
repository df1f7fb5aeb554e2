"""How large and how fast pictures and films of the 3D view are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import viser

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
                "<div style='font-size:12.5px;padding:2px 12px'>Your browser draws it as you see it here. Turn the "
                "view first; keep this window in front while a film is made.</div>"
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
