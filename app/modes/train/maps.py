"""The policy map of a run and its picture: cells coloured by error, arrows from target to mean landing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from app.formatting import percent
from app.modes.train.plan_view import FLOOR_RGB, LINE_RGB, Picture, encode_plan
from app.modes.train.view import Details
from app.scene.prediction import TARGET_RGB
from app.shared.trainer import RunState
from app.shared.workspace import Workspace
from core.errors import RallyscopeError
from core.learning.agents.policy import read_policy
from core.learning.config import EnvironmentConfig
from core.learning.evaluation.policy_map import PolicyMap, map_policy
from core.learning.runs.run_files import seed_files
from core.table import NET_OVERHANG_M, TABLE_LENGTH_M, TABLE_WIDTH_M
from core.text import counted

Array = NDArray[np.float64]
LOW_M: Final = (-0.2, -0.92)
HIGH_M: Final = (1.65, 0.92)
"""Extent of the picture; arrows are clipped at its edge."""
PIXELS_PER_M: Final = 360
LEGEND_PX: Final = 64
"""Height of the legend below the table."""
ARROW_RGB: Final = (255, 255, 255)
LOST_RGB: Final = (20, 20, 24)
"""Colour of a target's dot where fewer than `MOST_RETURNED` come back."""
MAX_RETURNED: Final = 0.9
ERROR_COLOURS: Final = (
    (0.0, (40, 140, 96)),
    (50.0, (104, 160, 70)),
    (100.0, (190, 170, 60)),
    (200.0, (210, 110, 50)),
    (400.0, (140, 36, 60)),
)
"""Error in mm and RGB, interpolated linearly; larger errors have the last colour."""


def draw_map(found: PolicyMap) -> Picture:
    """(H, W, 3) RGB: the net at the left, the opponent's end at the right, +y up, a legend below."""
    size = (np.array(HIGH_M) - LOW_M) * PIXELS_PER_M
    picture = np.full((round(size[1]) + LEGEND_PX, round(size[0]), 3), FLOOR_RGB, np.uint8)
    half_cell = np.array(found.cell_m) / 2
    for target, error_mm in zip(found.targets_m, found.errors_mm, strict=True):
        cv2.rectangle(
            picture, _pixel(target - half_cell), _pixel(target + half_cell), error_rgb(float(error_mm)), cv2.FILLED
        )
    _draw_table(picture)
    _draw_trained(picture, found)
    for target, landing, returned in zip(found.targets_m, found.landings_m, found.returned, strict=True):
        if np.isfinite(landing).all():
            length_px = PIXELS_PER_M * max(0.02, float(np.hypot(*(landing - target))))
            tip = min(0.4, 9 / length_px)
            cv2.arrowedLine(picture, _pixel(target), _pixel(landing), ARROW_RGB, 2, cv2.LINE_AA, 0, tip)
        dot = ARROW_RGB if returned >= MAX_RETURNED else LOST_RGB
        cv2.circle(picture, _pixel(target), 6, dot, cv2.FILLED, cv2.LINE_AA)
    _draw_legend(picture)
    return picture


def error_rgb(error_mm: float) -> tuple[int, int, int]:
    """The colour of a cell."""
    steps = [step for step, _ in ERROR_COLOURS]
    red, green, blue = (
        round(float(np.interp(error_mm, steps, [rgb[k] for _, rgb in ERROR_COLOURS]))) for k in range(3)
    )
    return red, green, blue


def _draw_table(picture: Picture) -> None:
    end, side = TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2
    cv2.rectangle(picture, _pixel((0.0, -side)), _pixel((end, side)), LINE_RGB, 2)
    reach = side + NET_OVERHANG_M
    cv2.line(picture, _pixel((0.0, -reach)), _pixel((0.0, reach)), LINE_RGB, 6)


def _draw_trained(picture: Picture, found: PolicyMap) -> None:
    """The box of targets of the training, or rings round the one target."""
    if found.trained.is_one:
        for radius_m in (0.05, 0.10):
            cv2.circle(picture, _pixel(found.trained.low_m), round(radius_m * PIXELS_PER_M), TARGET_RGB, 3, cv2.LINE_AA)
    else:
        cv2.rectangle(picture, _pixel(found.trained.low_m), _pixel(found.trained.high_m), TARGET_RGB, 3)


def _draw_legend(picture: Picture) -> None:
    height, width = picture.shape[:2]
    left, right, top = 30, width - 100, height - LEGEND_PX + 6
    highest = ERROR_COLOURS[-1][0]
    for x in range(left, right):
        rgb = error_rgb(highest * (x - left) / (right - left))
        cv2.line(picture, (x, top), (x, top + 18), rgb, 1)
    for step, _ in ERROR_COLOURS:
        x = round(left + (right - left) * step / highest)
        text = f"{step:.0f}" if step < highest else f"{step:.0f}+ mm"
        wide = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.75, 1)[0][0]
        at = min(x - 14, width - wide - 12), top + 46
        cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.75, LINE_RGB, 1, cv2.LINE_AA)


def _pixel(point_m: Array | tuple[float, float]) -> tuple[int, int]:
    x, y = np.clip(point_m, np.array(LOW_M) + 0.02, np.array(HIGH_M) - 0.02)
    return round((x - LOW_M[0]) * PIXELS_PER_M), round((HIGH_M[1] - y) * PIXELS_PER_M)


NO_POLICY: tuple[str, ...] = ("No policy yet: waiting for the first checkpoint.",)


@dataclass(frozen=True, slots=True)
class MapRequest:
    """Request of the map of a seed's last policy, at the speed of its last evaluation."""

    run: str
    seed: int
    speed_mps: float
    environment: EnvironmentConfig
    shown: object = None
    """The `key` of the map that is already shown."""


@dataclass(frozen=True, slots=True, eq=False)
class MapView:
    """A map as a picture with text."""

    key: object
    png: bytes | None
    """PNG picture; None: there is none, and the text says why."""
    words: tuple[str, ...]
    before_png: bytes | None = None
    """The map of the first policy that the run kept, on the same balls; None: it is the same, or there is none."""
    before_words: tuple[str, ...] = ()


def map_request(run: RunState, details: Details, shown: object) -> MapRequest:
    """The map of the newest seed of a run, at the speed of its last evaluation, or of its last stage."""
    speed = details.evaluations[-1].get("speed_mps") if details.evaluations else None
    known = float(speed) if isinstance(speed, (int, float)) else run.config.curriculum.speeds_mps[-1]
    return MapRequest(run.name, details.seed, known, run.config.environment, shown)


class MapViewer:
    """Answers the requests of one browser, one at a time."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._before: tuple[object, PolicyMap] | None = None
        """The last map of a first policy, and what it is of: it stays the same while a training goes on."""

    def __call__(self, request: MapRequest) -> MapView | None:
        """The map; None if it is already shown."""
        files = seed_files(self._workspace.run_path(request.run), request.seed)
        path = files.policy
        try:
            about = path.stat()  # taken before reading, so that a newer file is read again
        except OSError:
            key: object = (request.run, request.seed, None)
            return None if key == request.shown else MapView(key, None, NO_POLICY)
        key = (request.run, request.seed, about.st_mtime_ns, about.st_size, about.st_ino, request.speed_mps)
        if key == request.shown:
            return None
        try:
            found = map_policy(read_policy(path), request.environment, request.speed_mps)
            kept = files.kept_policies()
            first = kept[0] if len(kept) > 1 else None
            before = None if first is None else self._map_before(request, *first)
        except RallyscopeError as error:
            return MapView(key, None, (f"There is no map of this policy: {error}",))
        png, words = encode_plan(draw_map(found)), map_words(found, request.seed)
        if first is None or before is None:
            return MapView(key, png, words)
        return MapView(key, png, words, encode_plan(draw_map(before)), before_words(before, first[0]))

    def _map_before(self, request: MapRequest, episode: int, path: Path) -> PolicyMap:
        key = (request.run, request.seed, request.speed_mps, path.stat().st_mtime_ns)
        if self._before is None or self._before[0] != key:
            self._before = key, map_policy(read_policy(path), request.environment, request.speed_mps)
        return self._before[1]


def map_words(found: PolicyMap, seed: int) -> tuple[str, ...]:
    """Text lines that explain the picture."""
    inside = found.inside
    lines = [
        f"The last policy of seed {seed}: {len(inside)} targets, the same {found.serves} serves at "
        f"{found.speed_mps:g} m/s to each, without noise on the action. Arrows go from the target to the mean landing; "
        f"a black dot: fewer than {percent(MAX_RETURNED)} came back.",
    ]
    if found.trained.is_one:
        x, y = found.trained.low_m
        lines.append(f"Trained on one target, the rings: x {x:.2f} m, y {y:.2f} m. It was not trained on the others.")
    else:
        low, high = found.trained.low_m, found.trained.high_m
        lines.append(
            f"Trained on targets in the box, x {low[0]:.2f} to {high[0]:.2f} m, y {low[1]:.2f} to {high[1]:.2f} m."
        )
        if inside.any():
            lines.append(f"Inside the box {_result(found, inside)}.")
    lines.append(f"{'Whole half' if inside.all() or found.trained.is_one else 'Outside'} {_rest(found)}.")
    if found.known_exactly:
        lines.append("The ball's state is known here: cameras are not rendered for a map.")
    return tuple(lines)


def before_words(found: PolicyMap, episode: int) -> tuple[str, ...]:
    """Text lines above the map of the policy after `episode` balls, 0: before the first one."""
    kept = f"Before: the first policy that was kept, after {counted(episode, 'ball')}"
    what = "Before the training" if episode == 0 else kept
    everywhere = np.ones_like(found.inside)
    which = found.inside if found.inside.any() and not found.trained.is_one else everywhere
    return (f"{what}. On the same balls{'' if which.all() else ', inside the box'}: {_result(found, which)}.",)


def _rest(found: PolicyMap) -> str:
    inside = found.inside
    return _result(found, np.ones_like(inside) if inside.all() or found.trained.is_one else ~inside)


def _result(found: PolicyMap, which: np.ndarray) -> str:
    error_mm, returned = found.errors_mm[which].mean(), float(found.returned[which].mean())
    missed = float(found.missed[which].mean())
    text = f"{error_mm:.0f} mm from the target on average over all balls, net ignored; {percent(returned)} returned"
    return f"{text}, {percent(missed)} missed (2.74 m each)" if missed > 0 else text
