"""What Tune shows: camera, stage, zoom, one config or two."""

from __future__ import annotations

from collections.abc import Callable

import viser

from app.state.client_state import OVERLAYS, SLOTS, ClientState
from app.state.commands import ZOOM_RANGE, Command, LookAt, SetCamera, SetCompare, SetOverlay, SetSlot, SetZoom
from app.widgets import Choice, Listing, when_changed, when_clicked
from core.detection.methods import STAGED

FOLLOW, FOLLOWING, WHOLE = "Follow the ball", "Follows the ball", "Follow the ball: zoom in first"
"""What the button says: what it does, or why there is nothing to do."""


class TuneViewPanel:
    """Which window of which camera is looked at, and how closely."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Command], None]) -> None:
        self.folder = gui.add_folder("View")
        with self.folder:
            self._camera = Listing(gui, "Camera", lambda name: send(SetCamera(name)))
            self._overlay = Choice(
                gui, "Stage", OVERLAYS, lambda value: send(SetOverlay(value)),  # type: ignore[arg-type]
                hint="What each stage keeps; keys 1 to 6",
            )  # fmt: skip
            self._zoom = gui.add_slider("Zoom", *ZOOM_RANGE, 0.5, 1.0, hint="Click into the picture to centre it there")
            self._follow = gui.add_button("Follow the ball", icon=viser.Icon.FOCUS_2)
            self._slot = Choice(
                gui, "Config", SLOTS, lambda value: send(SetSlot(value)),  # type: ignore[arg-type]
                hint="The config that the sliders change",
            )  # fmt: skip
            self._compare = gui.add_checkbox("Compare A and B", False, hint="Both configs on the same window")
        when_changed(self._zoom, lambda value: send(SetZoom(float(str(value)))))
        when_changed(self._compare, lambda value: send(SetCompare(bool(value))))
        when_clicked(self._follow, lambda: send(LookAt(None)))

    def show(self, state: ClientState) -> None:
        """Follow the state."""
        self._camera.offer(state.cameras)
        self._camera.show(state.camera)
        self._overlay.visible = state.tune.method in STAGED and not state.tune.side_by_side
        self._compare.visible = not state.tune.side_by_side
        self._overlay.show(state.tune.overlay)
        self._zoom.value = state.tune.zoom
        following = state.tune.centre_px is None
        zoomed = state.tune.zoom > 1.0
        self._follow.disabled = following or not zoomed
        self._follow.label = FOLLOW if zoomed and not following else FOLLOWING if zoomed else WHOLE
        self._slot.show(state.tune.slot)
        self._compare.value = state.tune.compare
