"""Data sets: many simulated recordings by one plan, made in parallel and resumed after a stop, or selected flights."""

from typing import TYPE_CHECKING

from core.data_sets.card import CARD, MANIFEST, read_manifest
from core.data_sets.facts import RecordingFacts
from core.data_sets.plan import PRESETS, DataSetPlan, PlannedRecording, plan_data_set, preset_plan
from core.data_sets.run import DataSetRun, run_data_set

if TYPE_CHECKING:
    from core.data_sets.event_windows import EventWindows, collate_windows, count_pictures

__all__ = [
    "CARD",
    "MANIFEST",
    "PRESETS",
    "DataSetPlan",
    "DataSetRun",
    "EventWindows",
    "PlannedRecording",
    "RecordingFacts",
    "collate_windows",
    "count_pictures",
    "plan_data_set",
    "preset_plan",
    "read_manifest",
    "run_data_set",
]


def __getattr__(name: str) -> object:
    """What needs torch is loaded when it is first used."""
    if name in ("EventWindows", "collate_windows", "count_pictures"):
        from core.data_sets import event_windows

        return getattr(event_windows, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
