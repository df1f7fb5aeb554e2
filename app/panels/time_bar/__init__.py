"""The bar under the picture: transport, and a time line of what happens in the recording. Our script draws it."""

from app.panels.time_bar.time_bar import TimeBar
from app.panels.time_bar.tracks import (
    Runs,
    Tracks,
    moments_of,
    opening_us,
    runs_of_times,
    runs_of_verdicts,
    same_moments,
    tracks_of,
)

__all__ = [
    "Runs",
    "TimeBar",
    "Tracks",
    "moments_of",
    "opening_us",
    "runs_of_times",
    "runs_of_verdicts",
    "same_moments",
    "tracks_of",
]
