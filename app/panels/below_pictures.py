"""The floating panel below the pictures: where it is, and its last tab."""

from __future__ import annotations

from typing import Final

import viser

from app.panels.keys import keys_html

X_PX: Final = 8
Y_PX: Final = -86
"""Above the time bar."""
WIDTH_PX: Final = 860
HEIGHT_PX: Final = 140


def place_below_pictures(gui: viser.GuiApi, panel: viser.PanelHandle) -> None:
    """Add the list of keys as the last tab, and let the panel float in its place."""
    with panel.add_tab("Keys", viser.Icon.KEYBOARD):
        gui.add_html(keys_html())
    float_below_pictures(panel)


def float_below_pictures(panel: viser.PanelHandle, *, narrower_px: int = 0) -> None:
    """Let a panel float in its place, narrower while something stands at the left."""
    panel.float(x=X_PX, y=Y_PX, width=WIDTH_PX - narrower_px, height=HEIGHT_PX)
