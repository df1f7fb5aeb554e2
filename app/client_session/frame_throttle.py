"""Limits the frame rate of pages that are rendered on the CPU.

A page without a graphics card is drawn by the processor: every change anywhere on it costs 20 to 40 ms (Chromium at
1280x720), where a panel is drawn anew some times more. A live rally that runs on the same processor would have to wait
for the pictures of it. So such a page gets few, and all that changed at once; what stands in panels changes less often
still.
"""

from __future__ import annotations

from typing import Final

from app.state.client_state import ClientState
from app.web.pages import Message

FEW_EVERY_S: Final = 0.2


class FrameThrottle:
    """Limits the frame rate of one browser. Called by its loop, except `request_frame`."""

    def __init__(self) -> None:
        self._by_software = False
        self._hurried = True
        self._shown_s = float("-inf")

    def hear(self, message: Message) -> None:
        """Read the page's report of its renderer."""
        self._by_software = message.get("software") is True

    def hurry(self) -> None:
        """Draw the next frame at once, for a user's action; called from any thread."""
        self._hurried = True

    def spares(self, state: ClientState | None) -> bool:
        """Whether this is a live rally on a page that is rendered on the CPU."""
        return self._by_software and state is not None and state.playhead.live and state.playhead.playing

    def is_due(self, state: ClientState | None, wall_s: float) -> bool:
        """Whether the browser gets its next frame now."""
        if self.spares(state) and wall_s - self._shown_s < FEW_EVERY_S and not self._hurried:
            return False
        self._hurried, self._shown_s = False, wall_s
        return True
