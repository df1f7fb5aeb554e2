"""How good a detector is (precision, recall, pixel errors against truth), and how well flights are predicted."""

from core.metrics.run import WindowAnswers, run_detector
from core.metrics.score import Score, WindowVerdicts, judge_answers, known_truth, score_answers, score_recording

__all__ = [
    "Score",
    "WindowAnswers",
    "WindowVerdicts",
    "judge_answers",
    "known_truth",
    "run_detector",
    "score_answers",
    "score_recording",
]
