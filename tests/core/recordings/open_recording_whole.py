"""A recording opened as the app, `info` and the exports do between them: everything in it is asked for."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from core.history.following import add_known
from core.history.played_bodies import recorded_bodies
from core.history.rally_history import RallyHistory
from core.history.recorded_rally import PREDICTIONS
from core.recordings import CameraStream, open_recording
from core.recordings.reader import FileRecording
from core.recordings.truth import turning_points

SLICES = 6


def open_recording_whole(path: Path) -> tuple[str, ...]:
    """Its notes.

    Raises:
        RallyscopeError: if it is refused, as a whole or where a part is asked for.
        AssertionError: if it gives what no recording may hold.
    """
    with open_recording(path) as recording:
        assert recording.uuid != "not-to-be-read"
        assert 0 <= recording.duration_us <= 24 * 3600 * 10**6
        for stream in recording.cameras.values():
            _read_camera(stream, recording.duration_us)
        for frames in recording.frames.values():
            for number in range(len(frames)):
                image = frames.frame(number).image
                assert image.dtype == np.uint8 and image.ndim in (2, 3)
        ball = recording.ball
        if ball is not None:
            turning_points(ball)
            assert np.isfinite(ball.p_world_m[ball.visible]).all()
        _read_rally(recording)
        for group in recording.groups:
            recording.read_rows(group)
        assert all("\n" not in note for note in recording.notes)
        return recording.notes


def _read_camera(stream: CameraStream, duration_us: int) -> None:
    counts = stream.counts_per_ms()
    assert (counts >= 0).all() and counts.sum() == stream.event_count
    edges = np.linspace(0, min(duration_us, 10**7), SLICES + 1).astype(int)
    found = 0
    for start_us, end_us in pairwise(edges):
        events = stream.slice(int(start_us), int(end_us))
        found += len(events)
        if len(events):
            assert start_us <= events.t_us[0] and events.t_us[-1] < end_us and (np.diff(events.t_us) >= 0).all()
            assert set(np.unique(events.on.view(np.uint8))) <= {0, 1}
    assert duration_us > 10**7 or found == stream.event_count
    triggers, truth = stream.triggers, stream.truth
    assert len(triggers.t_us) == len(triggers.rising) == len(triggers.channel)
    if stream.calibration is not None:
        stream.calibration.project(np.array([[0.0, 0.0, 2.0]]))
    if truth is not None:
        seen = truth.at(np.arange(0, 50_000, 777))
        assert np.isfinite(np.column_stack([seen.u_px, seen.v_px])[seen.visible]).all()


def _read_rally(recording: FileRecording) -> None:
    history = RallyHistory()
    add_known(history, recording.ball, recording)
    history.at(30_000, {})
    recording.read_rows(PREDICTIONS)
    recorded_bodies(recording).at(30_000)
