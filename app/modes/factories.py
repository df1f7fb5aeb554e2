"""The modes by the names they have in the app."""

from __future__ import annotations

from typing import Final

from app.modes.export.mode import ExportMode
from app.modes.label.mode import LabelMode
from app.modes.mode import ModeFactory
from app.modes.train.mode import TrainMode
from app.modes.tune.mode import TuneMode
from app.modes.watch.mode import WatchMode
from app.state.client_state import ModeName

FACTORIES: Final[dict[ModeName, ModeFactory]] = {
    "Watch": WatchMode,
    "Tune": TuneMode,
    "Label": LabelMode,
    "Train": TrainMode,
    "Export": ExportMode,
}
"""Name of the mode -> what makes it for one browser."""
