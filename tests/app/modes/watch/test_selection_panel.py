"""Selected balls become a list to label and a file to train on; what cannot be is refused in a line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.modes.watch.selection_panel import list_to_label, write_data_set, write_training
from app.shared.ball_index import ball_sources, index_balls
from app.shared.workspace import Workspace
from core.data_sets import read_manifest
from core.errors import CommandError
from core.physics.ball_states import read_ball_states
from core.recordings import open_recording
from labels.balls.to_label import read_moments
from tests.app.shared.test_ball_index import write_recording


def test_the_times_of_a_selection_are_listed_by_recording(tmp_path: Path) -> None:
    paths = [write_recording(tmp_path / "recordings" / f"{name}.h5", (5.0, 6.0, 7.0)) for name in ("one", "two")]
    index = index_balls(ball_sources(tmp_path), tmp_path)
    assert "in 2 recordings: 3" in list_to_label(index, np.array([0, 2, 4]), Workspace(tmp_path))
    for path, times in zip(paths, ((0, 400_000), (200_000,)), strict=True):
        with open_recording(path) as recording:
            assert read_moments(tmp_path, recording.uuid) == times
    with pytest.raises(CommandError, match="no ball of a recording"):
        list_to_label(index, np.zeros(0, np.int64), Workspace(tmp_path))


def test_the_launches_of_a_selection_are_written_for_a_training(tmp_path: Path) -> None:
    write_recording(tmp_path / "recordings" / "one.h5", tuple(np.linspace(5, 7, 12)))
    index = index_balls(ball_sources(tmp_path), tmp_path)
    said = write_training(index, np.arange(10), Workspace(tmp_path), "fast")
    assert said.startswith("10 launches") and "train --balls" in said
    assert len(read_ball_states(tmp_path / "exports" / "fast.json")) == 10
    said = write_training(index, np.arange(12), Workspace(tmp_path), "fast")
    assert said.startswith("there is another fast already, so this is fast-2; 12 launches")
    assert len(read_ball_states(tmp_path / "exports" / "fast.json")) == 10, "an earlier file stays"
    with pytest.raises(CommandError, match="too few"):
        write_training(index, np.arange(3), Workspace(tmp_path), "few")


def test_the_flights_of_a_selection_are_written_as_a_data_set(tmp_path: Path) -> None:
    write_recording(tmp_path / "recordings" / "one.h5", (5.0, 6.0, 7.0))
    index = index_balls(ball_sources(tmp_path), tmp_path)
    said = write_data_set(index, np.arange(2), Workspace(tmp_path), "fast", "a line drawn round points")
    assert said.startswith("2 flights")
    selection = read_manifest(tmp_path / "data-sets" / "fast")["selection"]
    assert selection["selected_by"] == "a line drawn round points"
    said = write_data_set(index, np.arange(1), Workspace(tmp_path), "fast", "another line")
    assert said.startswith("there is another fast already, so this is fast-2; 1 flight")
    manifests = [read_manifest(tmp_path / "data-sets" / name) for name in ("fast", "fast-2")]
    assert [one["title"] for one in manifests] == ["fast", "fast-2"], "an earlier one stays"
