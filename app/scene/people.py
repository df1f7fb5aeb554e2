"""Simulated persons as balls and cylinders, light grey where their clothes are bright to the cameras."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from core.history.rally_picture import People
from core.simulation.bodies.parts import BLADE, KIND, RADIUS_A, RADIUS_B, REFLECTANCE

Array = NDArray[np.float64]

DARK_RGB: Final = (14, 17, 25)
BRIGHT_RGB: Final = (120, 128, 142)
"""Linear light, as the browser takes the colours of copies; they are lit, and darker than the ball."""
BRIGHT: Final = 0.6
"""Reflectance of the brightest clothes."""
AROUND: Final = 14
RINGS: Final = 8


@dataclass(frozen=True, slots=True, eq=False)
class Instances:
    """Copies of a mesh."""

    positions: Array
    """(N, 3)"""
    wxyzs: Array
    """(N, 4)"""
    scales: Array
    """(N, 3)"""


def balls_of(people: People) -> Instances:
    """A ball of radius 1, for both ends of each rod; a blade has none, so its are of size 0."""
    radii = people.parts[:, [RADIUS_A, RADIUS_B]] * (people.parts[:, KIND] != BLADE)[:, None]
    count = radii.size
    level = np.broadcast_to(np.array([1.0, 0.0, 0.0, 0.0]), (count, 4))
    return Instances(people.ends_m.reshape(-1, 3), level, np.repeat(radii.reshape(-1, 1), 3, axis=1))


def cylinders_of(people: People) -> Instances:
    """A cylinder of radius 1 and length 1 along z, for each part, from end to end."""
    along = people.ends_m[:, 1] - people.ends_m[:, 0]
    length = np.linalg.norm(along, axis=1)
    way = along / np.maximum(length, 1e-9)[:, None]
    # The shortest turn from z to the way; a way straight down turns about x.
    wxyzs = np.column_stack([1 + way[:, 2], -way[:, 1], way[:, 0], np.zeros(len(way))])
    wxyzs[np.linalg.norm(wxyzs, axis=1) < 1e-6] = (0.0, 1.0, 0.0, 0.0)
    wxyzs /= np.linalg.norm(wxyzs, axis=1, keepdims=True)
    radius = people.parts[:, [RADIUS_A, RADIUS_B]].mean(axis=1)
    return Instances(people.ends_m.mean(axis=1), wxyzs, np.column_stack([radius, radius, length]))


def part_colours(parts: Array) -> NDArray[np.uint8]:
    """(P, 3) RGB of parts (P, PART_COLUMNS)."""
    share = np.clip(parts[:, REFLECTANCE] / BRIGHT, 0, 1)[:, None]
    return np.round((1 - share) * DARK_RGB + share * BRIGHT_RGB).astype(np.uint8)


class PeopleActor:
    """All persons in one browser's scene: two handles, made anew only for another cast."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._scene, self._name = scene, name
        self._parts = np.empty((0, 0))
        self._handles: tuple[viser.BatchedMeshHandle, viser.BatchedMeshHandle] | None = None

    def show(self, people: People | None) -> None:
        """Stand there; None hides them."""
        if people is not None and not np.array_equal(people.parts, self._parts):
            self._build(people)
        if self._handles is None:
            return
        for handle in self._handles:
            handle.visible = people is not None
        if people is not None:
            balls, cylinders = self._handles
            balls.batched_positions = balls_of(people).positions.astype(np.float32)
            posed = cylinders_of(people)
            cylinders.batched_positions = posed.positions.astype(np.float32)
            cylinders.batched_wxyzs = posed.wxyzs.astype(np.float32)
            cylinders.batched_scales = posed.scales.astype(np.float32)

    def _build(self, people: People) -> None:
        for handle in self._handles or ():
            handle.remove()
        self._parts = people.parts
        colours = part_colours(people.parts)
        self._handles = (
            self._add("balls", _ball_mesh(), balls_of(people), np.repeat(colours, 2, axis=0)),
            self._add("cylinders", _cylinder_mesh(), cylinders_of(people), colours),
        )

    def _add(
        self,
        part: str,
        mesh: tuple[NDArray[np.float32], NDArray[np.uint32]],
        posed: Instances,
        colours: NDArray[np.uint8],
    ) -> viser.BatchedMeshHandle:
        return self._scene.add_batched_meshes_simple(
            f"{self._name}-{part}",
            *mesh,
            batched_wxyzs=posed.wxyzs,
            batched_positions=posed.positions,
            batched_scales=posed.scales,
            batched_colors=colours,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )


def _ball_mesh() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Vertices and triangles of a ball of radius 1."""
    down, turn = np.meshgrid(np.linspace(0, np.pi, RINGS + 1), np.arange(AROUND) * 2 * np.pi / AROUND, indexing="ij")
    vertices = np.stack([np.sin(down) * np.cos(turn), np.sin(down) * np.sin(turn), np.cos(down)], axis=-1)
    return vertices.reshape(-1, 3).astype(np.float32), _tube_triangles(RINGS)


def _cylinder_mesh() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Vertices and triangles of a closed cylinder of radius 1 and length 1 along z."""
    turn = np.arange(AROUND) * 2 * np.pi / AROUND
    rim = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rings = [(0.0, 0.5), (1.0, 0.5), (1.0, 0.5), (1.0, -0.5), (1.0, -0.5), (0.0, -0.5)]  # twice: with sharp edges
    vertices = np.concatenate([np.column_stack([radius * rim, np.full(AROUND, z)]) for radius, z in rings])
    triangles = _tube_triangles(len(rings) - 1).reshape(len(rings) - 1, -1, 3)[[0, 2, 4]].reshape(-1, 3)
    return vertices.astype(np.float32), triangles


def _tube_triangles(lengths: int) -> NDArray[np.uint32]:
    """Between neighbouring rings of `AROUND` vertices, from the upper one to the lower; seen from outside."""
    ring, corner = np.meshgrid(np.arange(lengths), np.arange(AROUND), indexing="ij")
    here, beside = ring * AROUND + corner, ring * AROUND + (corner + 1) % AROUND
    first = np.stack([here, here + AROUND, beside], axis=-1).reshape(lengths, -1, 3)
    second = np.stack([beside, here + AROUND, beside + AROUND], axis=-1).reshape(lengths, -1, 3)
    return np.concatenate([first, second], axis=1).reshape(-1, 3).astype(np.uint32)
