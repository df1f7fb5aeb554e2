"""State of the detector from window to window, and the trace of one window."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.detection.detector import Detection
from core.detection.reasons import Reason
from core.detection.stages.flicker import FlickerMemory
from core.detection.stages.geometry import Shape
from core.detection.stages.hot_pixels import HotPixelMemory
from core.detection.stages.localise import Circle
from core.detection.stages.roi import Roi
from core.events import Events


@dataclass(frozen=True, slots=True, eq=False)
class TrackState:
    """Complete state of a detector. The pixel memories are None while their stages are off."""

    centre_px: tuple[float, float] | None = None
    """Centre of the region of interest; None: the whole sensor."""
    misses: int = 0
    """Windows without a ball since the last one with."""
    on_leads: float = 0.0
    """Remembered evidence that ON is the leading polarity (above 0) or OFF is (below 0); used by `auto`."""
    hot_pixels: HotPixelMemory | None = None
    flicker: FlickerMemory | None = None


@dataclass(frozen=True, slots=True, eq=False)
class StageTrace:
    """Result of one stage."""

    name: str
    events: Events
    count_in: int
    count_out: int
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """One cluster, measured as far as possible even if an early test rejected it."""

    label: int
    rows: NDArray[np.intp]
    """Its events of both polarities, as ascending row numbers of the denoised events."""
    events: Events
    leading_on: bool
    """Polarity of its leading edge."""
    leading_evidence: float
    """Evidence from this cluster alone: above 0 for ON, below 0 for OFF."""
    leading_rows: NDArray[np.intp]
    """The events of the leading polarity without outliers, as row numbers like `rows`."""
    leading_events: Events
    shape: Shape | None
    """Hull, circularity and solidity of the leading events; None when there are none."""
    circle: Circle | None
    reasons: tuple[Reason, ...]
    """Every limit that it failed, in the order of the stages."""
    rejected_by: str | None
    """Name of the stage that rejected it."""

    @property
    def rejected(self) -> str | None:
        """Why it is not a ball, with the numbers of the first limit; None if it is one."""
        return self.reasons[0].text if self.reasons else None

    @property
    def size(self) -> int:
        """Number of its events, of both polarities."""
        return len(self.rows)


@dataclass(frozen=True, slots=True, eq=False)
class PipelineTrace:
    """Trace of one window through the detector."""

    stages: tuple[StageTrace, ...]
    """Those that ran, in order: hot_pixels, flicker (if enabled), roi, denoise, cluster, polarity, geometry, localise.
    From cluster on, the events that are kept are those of the candidates that are still in."""
    roi: Roi | None
    """Region of interest; None: the whole sensor was searched."""
    labels: NDArray[np.int32]
    """(N,) cluster of each event that denoising kept, -1 for none."""
    candidates: tuple[Candidate, ...]
    """Every cluster that was found, by label."""
    leading_on: bool
    """Leading polarity of the detection; without one, the default for a cluster without evidence."""
    detection: Detection | None
    extra_circles: int
    """Candidates that passed every test beside the detection."""
    state: TrackState
    """State of the track for the next window."""

    def stage(self, name: str) -> StageTrace:
        """Result of the stage of this name.

        Raises:
            KeyError: if it did not run.
        """
        for stage in self.stages:
            if stage.name == name:
                return stage
        raise KeyError(name)
