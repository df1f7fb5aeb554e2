"""Looking for a blinking board in the last second of every camera, for one browser, off the loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from core.cameras.calibration import Board, find_board
from core.cameras.calibration.coverage import cells_of
from core.recordings import Recording
from core.recordings.board_pictures import newest_blink

WIDEST_PX: Final = 700
"""A wider picture is halved: where a board is, is known well enough, and looking costs a quarter."""
BLOBS_A_DOT: Final = 4
"""With more spots than that, a picture has no dot board that could be found in time."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardSearchRequest:
    """Where to look, and when."""

    recording: Recording
    t_us: int
    board: Board


def search_board(request: BoardSearchRequest) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """The cells with a point of the board, of every camera in which the whole board blinked in the last second."""
    found = []
    for name, stream in request.recording.cameras.items():
        picture = newest_blink(stream, request.t_us)
        if picture is None:
            continue
        halved = 2 if stream.sensor.width_px > WIDEST_PX else 1
        if halved > 1:
            small = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            picture = np.asarray(small, np.uint8)
        most_blobs = BLOBS_A_DOT * request.board.rows * request.board.columns
        uvs = find_board(picture, request.board, most_blobs=most_blobs)
        if uvs is not None:
            cells = cells_of(halved * (uvs + 0.5) - 0.5, stream.sensor)
            found.append((name, tuple(np.unique(cells).tolist())))
    return tuple(found)
