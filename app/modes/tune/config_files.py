"""Saving and loading detector configs by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import viser

from app.widgets import Listing, when_clicked


class ConfigFilesPanel:
    """Names only: the server makes the file from the name, and offers only files that it finds."""

    def __init__(self, gui: viser.GuiApi, save: Callable[[str], None], load: Callable[[str], None]) -> None:
        self.folder = gui.add_folder("Config file")
        with self.folder:
            form = gui.add_form(None)  # Enter in its text means Save
            with form:
                self._name = gui.add_text("Name", "", hint="Saved by Enter, too; never over another one")
                when_clicked(gui.add_button("Save", icon=viser.Icon.DEVICE_FLOPPY), form.submit)
            self._saved = Listing(gui, "Saved", lambda name: None, hint="Configs in the workspace")
            when_clicked(gui.add_button("Load", icon=viser.Icon.FOLDER_OPEN), self._load)
        self._load_name = load

        @form.on_submit
        async def _(_: viser.GuiEvent) -> None:
            save(self._name.value)

    def show(self, names: tuple[str, ...], *, chosen: str | None = None) -> None:
        """Offer these configs, and choose one that was just saved."""
        self._saved.offer(names)
        if chosen is not None:
            self._saved.show(chosen)

    def _load(self) -> None:
        if self._saved.chosen is not None:
            self._load_name(self._saved.chosen)


def detect_command(method: str, config: Path) -> str:
    """What to type into a terminal to use a saved config on a recording."""
    return f"rallyscope detect RECORDING --method {method} --config {config} --out ball.csv"
