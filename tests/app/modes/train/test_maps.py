"""The map of a policy in Train: what is drawn, and when it is made anew."""

import dataclasses
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.modes.train.maps import (
    ARROW_RGB,
    ERROR_COLOURS,
    LOST_RGB,
    NO_POLICY,
    MapRequest,
    MapViewer,
    _pixel,
    draw_map,
    error_rgb,
    map_request,
    map_words,
)
from app.modes.train.view import RunsViewer, ViewRequest
from app.scene.prediction import TARGET_RGB
from app.shared.trainer import Trainer
from app.shared.training_records import MetricsStore
from app.shared.workspace import Workspace
from core.learning.config import EnvironmentConfig, GoalConfig
from core.learning.evaluation.policy_map import PolicyMap, map_policy
from core.learning.runs.run_files import load_policy, read_run, seed_files

KNOWN = EnvironmentConfig(state_source="truth")


@pytest.fixture
def found(trained: Workspace) -> PolicyMap:
    run = trained.run_path("small")
    return map_policy(load_policy(run, 0), read_run(run).environment, 5.0)


def test_a_small_training_places_balls_where_it_was_trained_and_worse_elsewhere(found: PolicyMap) -> None:
    assert found.errors_mm[found.inside].mean() < found.errors_mm[~found.inside].mean()
    assert found.errors_mm[found.inside].mean() < 298  # always landing in the middle of the box


def test_cells_have_the_colour_of_their_error_and_arrows_end_at_the_landing(found: PolicyMap) -> None:
    errors = found.errors_mm.copy()
    errors[:2] = (0.0, 5000.0)
    landings = found.landings_m.copy()
    landings[:] = found.targets_m
    landings[10] = found.targets_m[10] + [0.3, 0.0]
    landings[24] = np.nan
    returned = np.ones(len(errors))
    returned[12] = 0.5
    shown = dataclasses.replace(found, errors_mm=errors, landings_m=landings, returned=returned)
    picture = draw_map(shown)

    def at(place: np.ndarray) -> tuple[int, ...]:
        x, y = _pixel(place)
        return tuple(picture[y, x].tolist())

    corner = np.array(found.cell_m) * 0.35
    assert at(found.targets_m[0] + corner) == ERROR_COLOURS[0][1]
    assert at(found.targets_m[1] + corner) == ERROR_COLOURS[-1][1]
    assert at(found.targets_m[10] + [0.15, 0.0]) == ARROW_RGB
    assert at(found.targets_m[24] + [0.15, 0.0]) != ARROW_RGB  # it was never met, so no arrow
    assert at(found.targets_m[12]) == LOST_RGB and at(found.targets_m[13]) == ARROW_RGB
    assert at(np.array(found.trained.low_m)) == TARGET_RGB


def test_colours_tell_larger_errors_from_smaller_ones() -> None:
    colours = [error_rgb(step) for step in (0, 25, 50, 75, 100, 150, 200, 300, 400)]
    assert len(set(colours)) == len(colours) and error_rgb(1e5) == colours[-1]


def test_a_policy_of_one_target_says_so() -> None:
    one = dataclasses.replace(KNOWN, goal=GoalConfig(kind="fixed"))
    found = map_policy(lambda states, racket_speeds_mps, goals_m: np.zeros((len(states), 3)), one, 5.0, 4)
    words = " ".join(map_words(found, 3))
    assert "seed 3" in words and "Trained on one target" in words and "x 0.78 m, y 0.00 m" in words
    assert "box" not in words and "Whole half" in words
    assert "on average over all balls, net ignored; " in words, "not only over the returned ones"
    rings = draw_map(found)
    x, y = _pixel(found.trained.low_m)
    assert (rings[y, x - 45 : x + 45] == TARGET_RGB).all(axis=1).any()


def test_a_map_is_made_once_for_each_checkpoint(trained: Workspace, tmp_path: Path) -> None:
    workspace = Workspace(tmp_path / "workspace")
    shutil.copytree(trained.run_path("small"), workspace.run_path("small"))
    view = RunsViewer(workspace, Trainer(workspace), MetricsStore())(ViewRequest("small", None))
    assert view.run is not None and view.details is not None
    request = map_request(view.run, view.details, None)
    assert (request.run, request.seed, request.speed_mps) == ("small", 1, 5.0)
    viewer = MapViewer(workspace)
    first = viewer(request)
    assert first is not None and first.png is not None
    picture = cv2.imdecode(np.frombuffer(first.png, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert first.before_png is not None and first.before_png != first.png
    assert first.before_words[0].startswith("Before the training. On the same balls, inside the box: ")
    again = dataclasses.replace(request, shown=first.key)
    assert viewer(again) is None
    files = seed_files(workspace.run_path("small"), 1)
    assert [episode for episode, _ in files.kept_policies()] == list(range(0, 41, 4))
    files.policy.write_bytes(files.policy_at(4).read_bytes())  # another checkpoint
    later = viewer(again)
    assert later is not None and later.png is not None and later.png != first.png
    assert later.before_png == first.before_png
    files.policy_at(0).unlink()  # a run of an earlier version
    files.policy.write_bytes(files.policy_at(8).read_bytes())
    older = viewer(dataclasses.replace(request, shown=later.key))
    assert older is not None and older.before_words[0].startswith("Before: the first policy that was kept, after 4 ")


def test_without_a_policy_or_with_a_broken_one_the_words_say_why(trained: Workspace, tmp_path: Path) -> None:
    workspace = Workspace(tmp_path / "workspace")
    shutil.copytree(trained.run_path("small"), workspace.run_path("small"))
    viewer, request = MapViewer(workspace), MapRequest("small", 0, 5.0, KNOWN)
    files = seed_files(workspace.run_path("small"), 0)
    files.policy.write_bytes(b"\x80\x04not a policy")
    broken = viewer(request)
    assert broken is not None and broken.png is None and "cannot read the policy" in broken.words[0]
    assert viewer(dataclasses.replace(request, shown=broken.key)) is None
    files.policy.unlink()
    none = viewer(request)
    assert none is not None and none.png is None and none.words == NO_POLICY
