"""What a search for thresholds asks of a config where a person has labelled the ball."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from core.detection import DetectorConfig, make_detector
from core.metrics import WindowAnswers
from core.metrics.at_times import answers_at
from core.metrics.grid_score import GridScore
from core.metrics.score import MATCH_RADIUS_PX
from core.recordings import Recording
from core.tuning import SplitScore, TuningConfig
from core.tuning.objective import Cancelled, TimeBlocks, TuningStoppedError, cut_blocks
from labels.arrays import STATES, LabelArrays
from labels.model import LabelState

Against = Literal["truth", "labels"]
"""What a search is told the ball's place by."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelObjective:
    """A detector of that method is asked at each label of each camera, as for its score, but for occluded balls."""

    path: Path
    method: str
    labels: Mapping[str, LabelArrays]
    """Labels of each camera."""
    blocks: TimeBlocks

    def score(self, recording: Recording, config: DetectorConfig, cancelled: Cancelled) -> SplitScore:
        """Score of all cameras together."""

        def look(share: float) -> None:
            if cancelled():
                raise TuningStoppedError

        total = SplitScore()
        for name, labels in self.labels.items():
            stream = recording.cameras[name]
            detector = make_detector(self.method, stream.sensor, config)
            answers = answers_at(stream, detector, labels.t_us, config.window.window_us, progress=look)
            sides = (self.blocks.tuned(labels.t_us), self.blocks.held_out(labels.t_us))
            total += SplitScore(*(count_answers(answers, labels, side) for side in sides))
        return total


def label_objective(
    path: Path, method: str, labels: Mapping[str, LabelArrays], config: TuningConfig | None = None
) -> LabelObjective:
    """The objective for the labels of one or more cameras of a recording.

    Raises:
        RecordingError: if too few of them see a ball.
    """
    config = config or TuningConfig()
    asked = {name: of.rows(of.state != STATES.index(LabelState.OCCLUDED)) for name, of in labels.items()}
    seen_us = np.concatenate([of.t_us[of.seen] for of in asked.values()])
    return LabelObjective(path, method, asked, cut_blocks(seen_us, config.blocks, config.gap_us))


def count_answers(answers: WindowAnswers, labels: LabelArrays, rows: NDArray[np.bool_]) -> GridScore:
    """Counts and errors of the answers to labels, row by row, in those rows."""
    error = np.hypot(answers.u_px - labels.x_px, answers.v_px - labels.y_px)
    found = rows & labels.seen & (np.nan_to_num(error, nan=np.inf) <= MATCH_RADIUS_PX)
    answered = rows & answers.detected
    return GridScore(
        asked=int((rows & labels.seen).sum()),
        found=int(found.sum()),
        answers=int(answered.sum()),
        false=int((answered & ~found).sum()),
        error_px=error[found],
    )
