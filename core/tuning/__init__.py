"""Automatic tuning of a detector's thresholds against truth or labels, with part of the recording held out."""

from core.tuning.objective import Objective, SplitScore, TuningConfig, truth_objective
from core.tuning.parameters import choose_parameters
from core.tuning.tune import TuningProgress, TuningResult, report_of, tune

__all__ = [
    "Objective",
    "SplitScore",
    "TuningConfig",
    "TuningProgress",
    "TuningResult",
    "choose_parameters",
    "report_of",
    "truth_objective",
    "tune",
]
