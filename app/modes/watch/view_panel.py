"""Controls of the view: 3D or pictures, viewpoint, layers."""

from __future__ import annotations

from collections.abc import Callable

import viser

from app import theme
from app.modes.watch.commands import EnlargeNextCamera, ShowLayer, ShowSpace
from app.modes.watch.status import landing_legend_html
from app.scene.world import LAYERS
from app.state.client_state import ClientState
from app.state.commands import Command
from app.widgets import Choice, when_changed, when_clicked, when_triggered
from core.chain.config import PREDICTIONS, PredictionName

IN_SPACE, FLAT = "3D", "Pictures"
WHY_FLAT_HTML = (
    f"<div style='font-size:12.5px;color:{theme.MUTED};padding:4px 12px'>Pictures only: 3D needs two cameras and their "
    "calibration (<code>rallyscope import LEFT RIGHT OUT.h5 --calibration FILE</code>).</div>"
)


class ViewPanel:
    """View controls of one browser."""

    def __init__(
        self,
        gui: viser.GuiApi,
        send: Callable[[Command], None],
        look_from: Callable[[str], None],
        look_again: Callable[[], None],
        save_picture: Callable[[], None],
        views: tuple[str, ...],
        predict: Callable[[str], None],
    ) -> None:
        """`predict` is given a name of `PREDICTIONS` that was chosen."""
        self._gui = gui
        self._look_from = look_from
        self._space = Choice(gui, "Show", (IN_SPACE, FLAT), lambda chosen: send(ShowSpace(chosen == IN_SPACE)))
        self._why_flat = gui.add_html(WHY_FLAT_HTML)
        self._views_folder = gui.add_folder(None)
        self._views = views
        self._add_views()
        self._prediction = gui.add_dropdown(
            "Prediction",
            PREDICTIONS,
            hint="filter: every point of the flight. paper: five points before and five after the bounce, as published",
        )
        when_changed(self._prediction, lambda name: predict(str(name)))
        self._layers_folder = gui.add_folder("Layers", expand_by_default=False)
        with self._layers_folder:
            self._layers = {layer: gui.add_checkbox(layer, True) for layer in LAYERS}
            gui.add_html(landing_legend_html())
            self._save = gui.add_button(
                "Save this view as PNG", icon=viser.Icon.CAMERA, hint="Rendered by your browser"
            )
        when_clicked(self._save, save_picture)
        next_camera = gui.add_command("Larger picture: next camera, then the scene", hotkey="G")
        when_triggered(next_camera, lambda: send(EnlargeNextCamera()))
        when_triggered(gui.add_command("Reset to the chosen view", hotkey="V"), look_again)
        for layer, box in self._layers.items():
            when_changed(box, lambda on, layer=layer: send(ShowLayer(layer, bool(on))))

    def show(
        self,
        state: ClientState,
        *,
        is_stereo: bool,
        knows_ball: bool,
        views: tuple[str, ...],
        prediction: PredictionName,
    ) -> None:
        """Update from the state; a recording that is not stereo has no 3D."""
        self._prediction.visible, self._prediction.value = is_stereo, prediction
        in_space = is_stereo and state.watch.in_space and not state.watch.large
        self._space.show(IN_SPACE if in_space else FLAT)
        self._space.visible, self._why_flat.visible = is_stereo, not is_stereo
        self._views_folder.visible = self._layers_folder.visible = in_space
        if views != self._views:
            self._views = views
            self._dropdown.options = views
        for layer, box in self._layers.items():
            box.value = layer not in state.watch.hidden
        self._layers["True ball"].visible = knows_ball

    def _add_views(self) -> None:
        with self._views_folder:
            self._dropdown = self._gui.add_dropdown(
                "View", self._views, hint="Drag to turn, wheel to zoom; V resets the view"
            )
        when_changed(self._dropdown, lambda view: self._look_from(str(view)))
