"""How Rallyscope looks: dark, orange, no viser logo, no sharing."""

from __future__ import annotations

import functools
import zipfile
from typing import Final

import viser

from app.viser_parts import icon_users, icons_file

BRAND_RGB: Final = (255, 140, 40)
PANEL_WIDTH_PX: Final = 400
GOOD: Final = "#6eeb82"
BAD: Final = "#ff8a7a"
WARN: Final = "#ffd166"
MUTED: Final = "#8b8f98"


def hex_colour(rgb: tuple[int, int, int]) -> str:
    """A colour as HTML and charts want it."""
    return "#{:02x}{:02x}{:02x}".format(*rgb)


def apply_theme(server: viser.ViserServer) -> None:
    """Dress a fresh server and switch off everything that would leave this machine."""
    server.request_share_url = lambda *args, **kwargs: None  # a browser can ask for a public tunnel; it gets none
    server.gui.configure_theme(dark_mode=True, brand_color=BRAND_RGB, show_logo=False, show_share_button=False)
    server.gui.set_panel_label("Rallyscope")
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(PANEL_WIDTH_PX)
    server.scene.configure_default_lights(False)
    server.scene.configure_environment_map(hdri=None)
    for module in icon_users():
        module.svg_from_icon = _icon_svg  # where viser looks it up


@functools.cache
def _icon_svg(name: str) -> str:
    """An icon of viser's, which remembers 32, fewer than we show, and reads its whole directory for any other."""
    return _icon_archive().read(f"{name}.svg").decode("utf-8")


@functools.cache
def _icon_archive() -> zipfile.ZipFile:
    return zipfile.ZipFile(icons_file())
