"""What the chain expects: the flight before and after the bounce, the bounce, the hitting plane, where balls are to
land and did, coloured by their case; and how sure it is: a tube round the path, and ellipses of the bounce and
the hit, two standard deviations.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from core.history.rally_picture import LandingSpot, UncertaintyEllipse
from core.history.shown_prediction import PATH_POINTS
from core.physics.episode import Case

CASE_RGB: Final[dict[Case, tuple[int, int, int]]] = {
    Case.OWN_HALF: (255, 170, 0),
    Case.NET: (197, 90, 255),
    Case.OUT: (255, 40, 40),
    Case.RETURNED: (38, 230, 157),
    Case.MISSED: (127, 132, 145),
}
CASE_NAMES: Final[dict[Case, str]] = {
    Case.OWN_HALF: "own half",
    Case.NET: "net",
    Case.OUT: "out",
    Case.RETURNED: "returned",
    Case.MISSED: "missed",
}
TARGET_RGB: Final = (255, 255, 255)
SPOTS: Final = 500
"""Most landing points shown; the newest are kept."""
SPOT_RADIUS_M: Final = 0.02
"""That of the ball: a smaller disc is less than a pixel high in the usual view."""
SPOT_SHADE: Final = 0.4
"""The lamps stand over the table: on a surface that faces them all, colours would be nearly white."""
SPOT_CORNERS: Final = 12
SPOT_ABOVE_M: Final = 0.003
"""Height of the spots over the table, above its lines; the target lies above the spots."""
REACH_M: Final = 4.0
"""A spot farther from the middle than this is not drawn."""


class LandingActors:
    """The target and the spots in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        rings = np.concatenate([ring(0.05), ring(0.10)])
        self._target = scene.add_line_segments(f"{root}/target", rings, TARGET_RGB, thickness=0.008, visible=False)
        vertices, faces = spot_disc()
        self._spots = scene.add_batched_meshes_simple(
            f"{root}/spots",
            vertices,
            faces,
            np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (SPOTS, 1)),
            np.zeros((SPOTS, 3), np.float32),
            batched_scales=np.zeros(SPOTS, np.float32),
            batched_colors=np.zeros((SPOTS, 3), np.uint8),
            lod="off",
            side="double",
            material="toon3",  # without gloss
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        self._goal: NDArray[np.float64] | None = None
        self._shown: tuple[LandingSpot, ...] = ()

    def show(self, target: NDArray[np.float64] | None, spots: tuple[LandingSpot, ...]) -> None:
        """The target (2,), and the spots, oldest first."""
        self._target.visible = target is not None
        if target is not None and target is not self._goal:
            self._goal = target
            self._target.position = (target[0], target[1], 2 * SPOT_ABOVE_M)
        if spots == self._shown:
            return
        self._shown = spots
        near = [spot for spot in spots[-SPOTS:] if max(abs(spot.x_m), abs(spot.y_m)) < REACH_M]
        self._spots.visible = bool(near)
        if near:
            positions, scales = np.zeros((SPOTS, 3), np.float32), np.zeros(SPOTS, np.float32)
            colours = np.zeros((SPOTS, 3), np.uint8)
            positions[: len(near)] = [(spot.x_m, spot.y_m, SPOT_ABOVE_M) for spot in near]
            colours[: len(near)] = SPOT_SHADE * np.array([CASE_RGB[spot.case] for spot in near])
            scales[: len(near)] = 1.0  # the others have no size: the handle always has as many, and is reused
            self._spots.batched_positions, self._spots.batched_colors = positions, colours
            self._spots.batched_scales = scales


def spot_disc() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """A flat horizontal disc of `SPOT_RADIUS_M`: vertices (N + 1, 3), m, and its triangles (N, 3)."""
    rim = _circle(SPOT_CORNERS) * SPOT_RADIUS_M
    vertices = np.zeros((SPOT_CORNERS + 1, 3), np.float32)
    vertices[1:, :2] = rim
    corner = np.arange(SPOT_CORNERS)
    faces = np.stack([np.zeros_like(corner), corner + 1, (corner + 1) % SPOT_CORNERS + 1], axis=1)
    return vertices, faces.astype(np.uint32)


Array = NDArray[np.float64]
TUBE_RGB: Final = (0, 190, 255)
SIGMAS: Final = 2.0
"""Size of tubes, ellipses and ellipsoids of the uncertainty, in standard deviations."""
RINGS: Final = 20
"""A tube always has this many, so that its handle is reused."""
CORNERS: Final = 12
ELLIPSES: Final = 2
"""Number of ellipses: of the bounce and of the hit."""
ELLIPSE_CORNERS: Final = 32


def _circle(corners: int) -> Array:
    """(corners, 2) points of a circle, not closed."""
    angles = np.arange(corners) * (2 * np.pi / corners)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


_CIRCLE: Final = _circle(CORNERS)
_ELLIPSE: Final = np.concatenate([_circle(ELLIPSE_CORNERS), _circle(ELLIPSE_CORNERS)[:1]])


class UncertaintyActor:
    """The tube in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._tube = scene.add_mesh_simple(
            name,
            np.zeros((RINGS * CORNERS, 3), np.float32),
            tube_faces(),
            color=TUBE_RGB,
            opacity=0.30,
            side="double",
            visible=False,
            cast_shadow=False,
            receive_shadow=False,
        )
        flat = np.zeros((ELLIPSE_CORNERS, 2, 3), np.float32)
        self._ellipses = [
            scene.add_line_segments(f"{name}/ellipse-{number}", flat, TUBE_RGB, thickness=0.005, visible=False)
            for number in range(ELLIPSES)
        ]

    def show(self, ps_world_m: Array, sigmas_m: Array, spreads: tuple[UncertaintyEllipse, ...]) -> None:
        """Along a path (N, 3) with its standard deviations (N, 3); fewer than two points hide the tube."""
        for handle, spread in zip(self._ellipses, (*spreads, None, None), strict=False):
            handle.visible = spread is not None
            if spread is not None:
                handle.points = ellipse(spread)
        self._tube.visible = len(ps_world_m) > 1
        if len(ps_world_m) > 1:
            self._tube.vertices = tube_vertices(ps_world_m, sigmas_m)


def ellipse(spread: UncertaintyEllipse) -> NDArray[np.float32]:
    """(ELLIPSE_CORNERS, 2, 3) segments, SIGMAS standard deviations from the middle."""
    points = spread.centre + SIGMAS * _ELLIPSE @ spread.axes
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)


def tube_faces() -> NDArray[np.uint32]:
    """(2 (RINGS - 1) CORNERS, 3) triangles between neighbouring rings."""
    ring, corner = np.meshgrid(np.arange(RINGS - 1), np.arange(CORNERS), indexing="ij")
    here, beside = ring * CORNERS + corner, ring * CORNERS + (corner + 1) % CORNERS
    lower = np.stack([here, beside, here + CORNERS], axis=-1)
    upper = np.stack([beside, beside + CORNERS, here + CORNERS], axis=-1)
    return np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)]).astype(np.uint32)


def tube_vertices(ps_world_m: Array, sigmas_m: Array) -> NDArray[np.float32]:
    """(RINGS CORNERS, 3): ellipses across the path, SIGMAS standard deviations wide and high on each side."""
    ps, sigmas = _rows_for_rings(ps_world_m), _rows_for_rings(sigmas_m)
    along = np.empty_like(ps)
    along[1:-1], along[0], along[-1] = ps[2:] - ps[:-2], ps[1] - ps[0], ps[-1] - ps[-2]
    along /= np.maximum(np.sqrt((along * along).sum(axis=1, keepdims=True)), 1e-9)
    side = np.stack([along[:, 1], -along[:, 0], np.zeros(RINGS)], axis=1)
    side /= np.maximum(np.hypot(along[:, 0], along[:, 1])[:, None], 1e-9)
    up = np.stack(
        [side[:, 1] * along[:, 2], -side[:, 0] * along[:, 2], side[:, 0] * along[:, 1] - side[:, 1] * along[:, 0]],
        axis=1,
    )
    half = [SIGMAS * np.sqrt(((axis * sigmas) ** 2).sum(axis=1))[:, None, None] for axis in (side, up)]
    cos, sin = _CIRCLE[None, :, :1], _CIRCLE[None, :, 1:]
    rings = ps[:, None] + half[0] * cos * side[:, None] + half[1] * sin * up[:, None]
    return rings.reshape(-1, 3).astype(np.float32)


def _rows_for_rings(values: Array) -> Array:
    """(RINGS, 3) of values (N, 3) along a path."""
    if len(values) == RINGS:
        return values
    rows, at = np.arange(len(values)), np.linspace(0, len(values) - 1, RINGS)
    return np.stack([np.interp(at, rows, values[:, k]) for k in range(3)], axis=1)


BEFORE_RGB: Final = (176, 205, 255)
AFTER_RGB: Final = (0, 229, 255)
"""What is expected is cold, what was seen is warm: told apart without seeing red or green."""
PLANE_RGB: Final = (120, 150, 200)
BEFORE_PX: Final = 2.5
AFTER_PX: Final = 4.0
PLANE_PX: Final = 1.2
BOUNCE_M: Final = 0.05
STILL_M: Final = 0.001
"""What is expected trembles by less from one prediction to the next; nobody would see it, so it is not sent."""
PLANE_WIDTH_M: Final = 1.6
PLANE_HEIGHT_M: Final = 0.7
ABOVE_M: Final = 0.002
PLACE_RGB: Final = (96, 150, 170)
REFUSED_RGB: Final = (110, 90, 90)
"""Pale: the places that were not chosen."""
PLACE_M: Final = 0.022
PLACES: Final = 24
"""Most places shown of each kind; the choice has 14."""


class PredictionActors:
    """The predictions in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, root: str, *, plane_x_m: float) -> None:
        flat = np.zeros((PATH_POINTS - 1, 2, 3), np.float32)
        self._before, self._after = (
            scene.add_line_segments(f"{root}/{name}", flat, rgb, thickness=px, thickness_units="screen", visible=False)
            for name, rgb, px in (("before", BEFORE_RGB, BEFORE_PX), ("after", AFTER_RGB, AFTER_PX))
        )
        self._bounce = scene.add_line_segments(
            f"{root}/bounce", ring(BOUNCE_M), AFTER_RGB, thickness=0.010, visible=False
        )
        self._hit = scene.add_icosphere(f"{root}/hit", 0.026, AFTER_RGB, opacity=0.8, visible=False, cast_shadow=False)
        empty = np.zeros((4 * PLACES, 2, 3), np.float32)
        self._places, self._refused = (
            scene.add_line_segments(f"{root}/{name}", empty, rgb, thickness=0.004, visible=False)
            for name, rgb in (("places", PLACE_RGB), ("refused", REFUSED_RGB))
        )
        self._paths: list[Array | None] = [None, None]
        self._bounces: Array | None = None
        self._hits: Array | None = None
        """Shown now: pictures of neighbouring moments share their values, and what did not change is not sent."""
        corners = np.array([[0, -0.5, 0.0], [0, 0.5, 0.0], [0, 0.5, 1.0], [0, -0.5, 1.0]])
        corners = corners * [1, PLANE_WIDTH_M, PLANE_HEIGHT_M] + [plane_x_m, 0.0, -0.05]
        edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).astype(np.float32)
        self._plane = scene.add_line_segments(
            f"{root}/plane", edges, PLANE_RGB, thickness=PLANE_PX, thickness_units="screen"
        )

    def show_places(self, places: Array, refused: Array) -> None:
        """Where else the ball could be hit (N, 3), and where it cannot (M, 3); empty to hide them."""
        for handle, ps_m in ((self._places, places), (self._refused, refused)):
            handle.visible = len(ps_m) > 0
            if len(ps_m) and not np.array_equal(points := diamonds(ps_m), handle.points):
                handle.points = points

    def show(self, before: Array, after: Array, bounce: Array | None, hit: Array | None, *, plane: bool) -> None:
        """The paths (N, 3), empty to hide them; the points (3,).

        Args:
            before: (N, 3) path of the prediction before the bounce, world, m.
            after: (M, 3) path of the one after it.
            bounce: (3,) where it bounces.
            hit: (3,) where it is to be hit.
            plane: whether the hitting plane is drawn.
        """
        for number, (handle, path) in enumerate(((self._before, before), (self._after, after))):
            handle.visible = len(path) > 1
            if len(path) > 1 and path is not self._paths[number]:
                self._paths[number] = path
                handle.points = segments(path, PATH_POINTS)
        self._bounce.visible = bounce is not None
        if bounce is not None and _moved(bounce, self._bounces):
            self._bounces = bounce
            self._bounce.position = (bounce[0], bounce[1], ABOVE_M)
        self._hit.visible = hit is not None
        if hit is not None and _moved(hit, self._hits):
            self._hits = hit
            self._hit.position = hit
        self._plane.visible = plane


def _moved(p: Array, before: Array | None) -> bool:
    return before is None or (p is not before and float(np.abs(p - before).max()) > STILL_M)


def segments(path: Array, points: int) -> NDArray[np.float32]:
    """(points - 1, 2, 3) segments along a path (N, 3), N >= 2, evenly spaced in its rows."""
    at = np.linspace(0, len(path) - 1, points)
    rows = np.arange(len(path))
    even = np.stack([np.interp(at, rows, path[:, k]) for k in range(3)], axis=1)
    return np.stack([even[:-1], even[1:]], axis=1).astype(np.float32)


def diamonds(ps_world_m: Array) -> NDArray[np.float32]:
    """(4 PLACES, 2, 3) edges of an upright diamond round each of the points (N, 3), across the table's length.

    Always as many, so that the handle is reused: those without a point have no length.
    """
    corners = PLACE_M * np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    found = np.tile(ps_world_m[0], (PLACES, 4, 2, 1)).astype(np.float32)
    shown = ps_world_m[:PLACES]
    found[: len(shown)] = shown[:, None, None] + edges
    return found.reshape(-1, 2, 3)


def ring(radius_m: float, corners: int = 24) -> NDArray[np.float32]:
    """(corners, 2, 3) segments of a level circle round the origin."""
    angles = np.linspace(0, 2 * np.pi, corners + 1)
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1) * radius_m
    return np.stack([circle[:-1], circle[1:]], axis=1).astype(np.float32)
