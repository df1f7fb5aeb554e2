"""Flights of the ball: fitted to observed points and continued to the table and the hitting plane."""

from core.trajectory.config import PaperPredictorConfig, predictor_for
from core.trajectory.continuation import predict_arrivals
from core.trajectory.filter import FilterPredictor
from core.trajectory.filter_config import FilterConfig, filter_for, with_physics
from core.trajectory.observation import PixelObservation
from core.trajectory.prediction import HitPlane, Prediction, Predictor, TablePoint
from core.trajectory.predictor import PaperPredictor

__all__ = [
    "FilterConfig",
    "FilterPredictor",
    "HitPlane",
    "PaperPredictor",
    "PaperPredictorConfig",
    "PixelObservation",
    "Prediction",
    "Predictor",
    "TablePoint",
    "filter_for",
    "predict_arrivals",
    "predictor_for",
    "with_physics",
]
