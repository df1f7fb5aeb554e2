"""The zoomed picture goes to the ball that the detector finds where nothing is labelled yet."""

import queue
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from app.modes.label.ball_search import BallRequest, BallSearch
from core.detection import DetectorConfig
from core.detection.saved import SavedDetector
from core.recordings import open_recording
from tests.waiting import eventually

BALL_US, NO_BALL_US = 300_000, 4_000
DETECTOR = SavedDetector("auto", DetectorConfig())


def test_the_ball_is_found_or_said_to_be_missing_and_the_newest_place_wins(serve_recording: Path) -> None:
    inbox: queue.SimpleQueue = queue.SimpleQueue()
    found: list[tuple[float, float]] = []
    errors: list[Exception] = []
    with open_recording(serve_recording) as recording, ThreadPoolExecutor(1) as pool:
        stream = recording.cameras["left"]
        search = BallSearch(pool, inbox.put, found.append, errors.append)

        def until(condition) -> None:
            def turn() -> bool:
                while not inbox.empty():
                    inbox.get()()
                return bool(condition())

            eventually(turn, "the search to end", lambda: (found, errors))

        search.want(BallRequest(stream, BALL_US, DETECTOR))
        until(lambda: found)
        truth = stream.truth.at(BALL_US)
        assert found == [pytest.approx((float(truth.u_px[0]), float(truth.v_px[0])), abs=4.0)] and not search.is_missing

        search.want(BallRequest(stream, NO_BALL_US, DETECTOR))
        until(lambda: search.is_missing)
        assert len(found) == 1

        search.want(BallRequest(stream, BALL_US, DETECTOR))
        search.want(None)  # the cursor has gone on to a label before the answer is there
        pool.submit(lambda: None).result()
        until(lambda: True)
        assert len(found) == 1 and not search.is_missing and not errors
        search.close()
