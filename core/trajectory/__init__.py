"""Flights of the ball: fitted to observed points and continued to the table and the hitting plane."""

from core.trajectory.config import PaperPredictorConfig, predictor_for
from core.trajectory.continuation import predict_arrivals
from core.trajectory.prediction import HitPlane, Prediction, TablePoint
from core.trajectory.predictor import PaperPredictor

__all__ = [
    "HitPlane",
    "PaperPredictor",
    "PaperPredictorConfig",
    "Prediction",
    "TablePoint",
    "predict_arrivals",
    "predictor_for",
]
