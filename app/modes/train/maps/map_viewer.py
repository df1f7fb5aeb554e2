"""The map of a run's last checkpoint for one browser, off the loop, made anew only for another checkpoint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.formatting.percent import percent
from app.modes.train.maps.map_picture import MAX_RETURNED, draw_map
from app.modes.train.plan_view import encode_plan
from app.modes.train.view import Details
from app.shared.training.run_state import RunState
from app.shared.workspace import Workspace
from core.errors import RallyscopeError
from core.learning.agents.policy import read_policy
from core.learning.config import EnvironmentConfig
from core.learning.evaluation.policy_map import PolicyMap, map_policy
from core.learning.runs.run_files import seed_files

NO_POLICY: tuple[str, ...] = ("No policy is saved yet: the first checkpoint is to come.",)


@dataclass(frozen=True, slots=True)
class MapRequest:
    """Whose map: the last policy of a seed, at the speed of its last evaluation."""

    run: str
    seed: int
    speed_mps: float
    environment: EnvironmentConfig
    shown: object = None
    """The `key` of what is shown already."""


@dataclass(frozen=True, slots=True, eq=False)
class MapView:
    """A map to look at."""

    key: object
    png: bytes | None
    """None: there is none, and the words say why."""
    words: tuple[str, ...]


def map_request(run: RunState, details: Details, shown: object) -> MapRequest:
    """The map of the newest seed of a run, at the speed of its last evaluation, or of its last stage."""
    speed = details.evaluations[-1].get("speed_mps") if details.evaluations else None
    known = float(speed) if isinstance(speed, (int, float)) else run.config.curriculum.speeds_mps[-1]
    return MapRequest(run.name, details.seed, known, run.config.environment, shown)


class MapViewer:
    """Answers the requests of one browser, one at a time."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace

    def __call__(self, request: MapRequest) -> MapView | None:
        """The map; None if it is the one that is shown."""
        path = seed_files(self._workspace.run_path(request.run), request.seed).policy
        try:
            about = path.stat()  # before it is read: a newer one is looked at again
        except OSError:
            key: object = (request.run, request.seed, None)
            return None if key == request.shown else MapView(key, None, NO_POLICY)
        key = (request.run, request.seed, about.st_mtime_ns, about.st_size, about.st_ino, request.speed_mps)
        if key == request.shown:
            return None
        try:
            found = map_policy(read_policy(path), request.environment, request.speed_mps)
        except RallyscopeError as error:
            return MapView(key, None, (f"There is no map of this policy: {error}",))
        return MapView(key, encode_plan(draw_map(found)), map_words(found, request.seed))


def map_words(found: PolicyMap, seed: int) -> tuple[str, ...]:
    """What the picture shows, in lines for people."""
    inside = found.inside
    lines = [
        f"The last policy of seed {seed}: {len(inside)} targets, the same {found.serves} serves at "
        f"{found.speed_mps:g} m/s to each, without noise on the action. Arrows go from the target to the mean landing; "
        f"a black dot: fewer than {percent(MAX_RETURNED)} came back.",
    ]
    if found.trained.is_one:
        x, y = found.trained.low_m
        lines.append(f"Trained on one target, the rings: x {x:.2f} m, y {y:.2f} m. All others are new to it.")
    else:
        low, high = found.trained.low_m, found.trained.high_m
        lines.append(
            f"Trained on targets in the box, x {low[0]:.2f} to {high[0]:.2f} m, y {low[1]:.2f} to {high[1]:.2f} m."
        )
        if inside.any():
            lines.append(f"Inside of the box {_result(found, inside)}.")
    lines.append(f"{'All over the half' if inside.all() or found.trained.is_one else 'Outside'} {_rest(found)}.")
    if found.known_exactly:
        lines.append("The ball's state is known here: cameras are not rendered for a map.")
    return tuple(lines)


def _rest(found: PolicyMap) -> str:
    inside = found.inside
    return _result(found, np.ones_like(inside) if inside.all() or found.trained.is_one else ~inside)


def _result(found: PolicyMap, which: np.ndarray) -> str:
    error_mm, returned = found.errors_mm[which].mean(), float(found.returned[which].mean())
    missed = float(found.missed[which].mean())
    text = f"{error_mm:.0f} mm from the target on the average, {percent(returned)} returned"
    return f"{text}, {percent(missed)} missed (2.74 m each)" if missed > 0 else text
