"""How good a detector is: matching against truth, precision, recall, pixel errors, benchmarks."""

from core.metrics.run import WindowAnswers, run_detector
from core.metrics.score import Score, score_answers, score_recording

__all__ = ["Score", "WindowAnswers", "run_detector", "score_answers", "score_recording"]
