"""Data sets: many simulated recordings by one plan, made in parallel, resumed after a stop, counted on a card."""

from core.data_sets.card import CARD, MANIFEST, read_manifest
from core.data_sets.facts import RecordingFacts
from core.data_sets.plan import DataSetPlan, PlannedRecording, plan_data_set
from core.data_sets.presets import PRESETS, preset_plan
from core.data_sets.run import DataSetRun, run_data_set

__all__ = [
    "CARD",
    "MANIFEST",
    "PRESETS",
    "DataSetPlan",
    "DataSetRun",
    "PlannedRecording",
    "RecordingFacts",
    "plan_data_set",
    "preset_plan",
    "read_manifest",
    "run_data_set",
]
