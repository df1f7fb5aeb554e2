"""The bar under the picture: transport, and a time line of what happens in the recording. Our script draws it."""

from app.panels.time_bar.time_bar import TimeBar
from app.panels.time_bar.tracks import Runs, Tracks, opening_us, runs_of_times, runs_of_verdicts, tracks_of

__all__ = ["Runs", "TimeBar", "Tracks", "opening_us", "runs_of_times", "runs_of_verdicts", "tracks_of"]
