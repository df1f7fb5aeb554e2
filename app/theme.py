"""How Rallyscope looks: dark, orange, no viser logo, no sharing."""

from __future__ import annotations

from typing import Final

import viser

BRAND_RGB: Final = (255, 140, 40)
PANEL_WIDTH_PX: Final = 400
GOOD: Final = "#6eeb82"
BAD: Final = "#ff8a7a"
WARN: Final = "#ffd166"
MUTED: Final = "#8b8f98"


def apply_theme(server: viser.ViserServer) -> None:
    """Dress a fresh server and switch off everything that would leave this machine."""
    server.request_share_url = lambda *args, **kwargs: None  # a browser can ask for a public tunnel; it gets none
    server.gui.configure_theme(dark_mode=True, brand_color=BRAND_RGB, show_logo=False, show_share_button=False)
    server.gui.set_panel_label("Rallyscope")
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(PANEL_WIDTH_PX)
    server.scene.configure_default_lights(False)
    server.scene.configure_environment_map(hdri=None)
