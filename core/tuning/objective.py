"""Objective of a search: the score of a config on both sides of the split, here against the truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from core.detection import DetectorConfig, make_detector
from core.errors import RecordingError
from core.metrics import run_detector
from core.metrics.grid_score import score_on_grid
from core.recordings import Recording
from core.tuning.config import TuningConfig
from core.tuning.split_score import SplitScore
from core.tuning.time_blocks import TimeBlocks, cut_blocks

Cancelled = Callable[[], bool]
ANY_SPEED: Final = (0.0, math.inf)


class TuningStoppedError(Exception):
    """The search was cancelled."""


class Objective(Protocol):
    """Scores configs on one recording: a frozen value that is sent to worker processes."""

    @property
    def path(self) -> Path:
        """The recording; each process opens it for itself."""
        ...

    def score(self, recording: Recording, config: DetectorConfig, cancelled: Cancelled) -> SplitScore:
        """The config's score.

        Raises:
            TuningStoppedError: when `cancelled()` becomes true.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class TruthObjective:
    """A detector of that method runs over the whole recording, and its answers are compared with the truth."""

    path: Path
    cameras: tuple[str, ...]
    method: str
    blocks: TimeBlocks
    near_us: int
    """Twice as far an answer may be from a time that asks for it: a window of the config to start from, whatever the
    windows of a trial, which would otherwise seem better for being longer."""

    def score(self, recording: Recording, config: DetectorConfig, cancelled: Cancelled) -> SplitScore:
        """Score of all cameras together."""
        total = SplitScore()
        for name in self.cameras:
            stream = recording.cameras[name]
            truth = stream.truth
            assert truth is not None, "checked when the objective was made"
            detector = make_detector(self.method, stream.sensor, config)
            answers = run_detector(stream, detector, config.window.window_us, cancelled=cancelled)
            if cancelled():
                raise TuningStoppedError
            tuned, held_out = (
                score_on_grid(answers, truth, stream.sensor, ANY_SPEED, window_us=self.near_us, counts=side)
                for side in (self.blocks.tuned, self.blocks.held_out)
            )
            total += SplitScore(tuned, held_out)
        return total


def truth_objective(
    path: Path,
    recording: Recording,
    cameras: Sequence[str],
    method: str,
    start: DetectorConfig,
    config: TuningConfig | None = None,
) -> TruthObjective:
    """Objective for the cameras of a recording that have the truth.

    Raises:
        RecordingError: if one of them knows none, or there are too few balls in it.
    """
    config = config or TuningConfig()
    times = []
    for name in cameras:
        truth = recording.cameras[name].truth
        if truth is None:
            remedy = "simulated recordings have one; a labelled recording is tuned against its labels"
            raise RecordingError("there is no ground truth to tune against", where=f"camera {name}", remedy=remedy)
        times.append(truth.t_us[truth.visible])
    blocks = cut_blocks(np.concatenate(times), config.blocks, config.gap_us)
    return TruthObjective(path, tuple(cameras), method, blocks, start.window.window_us)
