"""Automatic tuning of a detector's thresholds against truth or labels, with part of the recording held out."""

from core.tuning.config import TuningConfig
from core.tuning.objective import Objective, truth_objective
from core.tuning.parameters import choose_parameters
from core.tuning.report import report_of
from core.tuning.split_score import SplitScore
from core.tuning.tune import TuningProgress, TuningResult, tune

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
