"""Outcome of a stroke, classified from the points of the chain alone: case, landing, height at the net, each with how
sure that is.
"""

from core.outcomes.classifier import ClassifiedStroke, OutcomeClassifier
from core.outcomes.config import OutcomeClassifierConfig
from core.outcomes.serve_seen import ServeSeen

__all__ = ["ClassifiedStroke", "OutcomeClassifier", "OutcomeClassifierConfig", "ServeSeen"]
