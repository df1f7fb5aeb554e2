"""A browser of the soak: draws nothing, uses the app's buttons, fields and keys, and counts what it is sent."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, Final

from benchmarks.app.bare_browser import BareBrowser

MOVES: Final = frozenset({"SetPositionMessage", "SetOrientationMessage", "SceneNodeUpdateMessage"})


class Visitor(BareBrowser):
    """Connected as soon as it is made."""

    def __init__(self, port: int) -> None:
        self._controls: dict[str, str] = {}
        self._contents: dict[str, str] = {}
        """HTML of the panels, by their id."""
        self.updates: list[float] = []
        """When the server changed what the scene shows, monotonic seconds; many changes at once are one."""
        super().__init__(port)

    def press(self, label: str, timeout_s: float = 60.0) -> None:
        """Click the button."""
        self.change(label, True, timeout_s)

    def change(self, label: str, value: object, timeout_s: float = 60.0) -> None:
        """Set a field, a choice or a box."""
        self.wait_until(lambda: label in self._controls, f"a control {label!r}", timeout_s)
        self.set_value(self._controls[label], value)

    def wait_text(self, text: str, timeout_s: float = 60.0) -> None:
        """Until it stands in some panel."""
        self.wait_until(lambda: any(text in html for html in self._contents.copy().values()), repr(text), timeout_s)

    def rate(self, seconds: float, until_s: float) -> float:
        """Updates a second in the time before `until_s`."""
        return sum(until_s - seconds < at_s <= until_s for at_s in self.updates) / seconds

    def _take(self, message: Mapping[str, Any]) -> None:
        super()._take(message)
        kind = message["type"]
        content = (message.get("props") or message.get("updates") or {}).get("content")
        if isinstance(content, str):
            self._contents[message["uuid"]] = content
        if kind.startswith("Gui") and isinstance(message.get("props"), dict):
            label = message["props"].get("label")
            if label:
                self._controls[label] = message["uuid"]
        elif kind in MOVES and message["name"].startswith("/world/"):
            now_s = time.monotonic()
            if not self.updates or now_s - self.updates[-1] > 0.005:
                self.updates.append(now_s)
