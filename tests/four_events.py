"""Four events at the corners and in the middle of a sensor of 320x240, and reading them back from a source."""

from __future__ import annotations

import numpy as np

from core.events import Events, concatenate_events
from core.recordings.sources.source import DecodeReport, EventSource

T = np.array([5, 5, 9, 1_500_000])
X = np.array([0, 319, 3, 100])
Y = np.array([239, 0, 7, 50])
P = np.array([1, 0, 0, 1])


def read_all(source: EventSource) -> tuple[Events, DecodeReport]:
    """All events of a source, and what its reader reports."""
    report = DecodeReport()
    return concatenate_events(list(source.read(report)), source.sensor), report
