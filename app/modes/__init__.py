"""The modes of the app, one file each; Tune is the session's own."""

from __future__ import annotations

from typing import Final

from app.modes.export_mode import ExportMode
from app.modes.label import LabelMode
from app.modes.mode import Host, Mode, ModeFactory
from app.modes.train import TrainMode
from app.modes.watch import WatchMode

FACTORIES: Final[dict[str, ModeFactory]] = {
    "Watch": WatchMode,
    "Label": LabelMode,
    "Train": TrainMode,
    "Export": ExportMode,
}
"""Name of the mode -> what makes it for one browser."""

__all__ = ["FACTORIES", "Host", "Mode", "ModeFactory"]
