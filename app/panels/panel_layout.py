"""Width of a docked panel beside the 3D view: folded in a narrow window, wider in a wide one."""

from __future__ import annotations

from typing import Final, Literal

import viser

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
