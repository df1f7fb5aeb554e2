"""Outcome of a stroke, classified from the points of the chain alone: case, landing, height at the net, each with how
sure that is.
"""

from core.outcomes.ball_log import ServeSeen
from core.outcomes.classifier import OutcomeClassifier
from core.outcomes.config import OutcomeClassifierConfig
from core.outcomes.stroke import ClassifiedStroke

__all__ = ["ClassifiedStroke", "OutcomeClassifier", "OutcomeClassifierConfig", "ServeSeen"]
