"""Pictures of an ordinary colour camera: the same scene through the same lens, blurred by what moves while it exposes.

Linear light is averaged over instants of the exposure, closer together the faster something moves. Only pixels that
something moves over are worked on; the rest of a picture is the static room.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.config import check_settings, setting
from core.errors import ConfigError
from core.jit import njit
from core.simulation.bodies.actors import Clothes
from core.simulation.bodies.parts import REFLECTANCE, TEXTURE, BodyProbes, MovingBodies, probe_bodies, steps_of_fastest
from core.simulation.bodies.shading import (
    FAR_COVER,
    LOG_TOTAL,
    NEAR_COVER,
    SceneView,
    light_and_rest,
    posed_bodies,
    posed_parts,
)
from core.simulation.bodies.tile_updates import TILE_PX, TileUpdates, draw_tile, mark_moved
from core.simulation.bodies.view import make_scene_view
from core.simulation.flights import BallPath
from core.simulation.scenes.background import LOG_LIGHT, make_background
from core.simulation.scenes.ball_view import STEP_PX
from core.simulation.scenes.block_view import RacketView, Steps, flicker_log_light, moving_steps
from core.simulation.scenes.racket_view import RacketPath
from core.simulation.scenes.scene import SceneConfig
from core.simulation.scenes.shading import UNTOUCHED, Moving, pixel_seen

BallColour = Literal["orange", "white"]
Tint = tuple[float, float, float]
"""Red, green and blue relative to the brightness of the scene."""

TINTS: Final[dict[str, Tint]] = {
    "table": (0.35, 0.75, 2.0),
    "line": (1.0, 1.0, 1.0),
    "floor": (1.5, 0.75, 0.55),
    "wall": (0.85, 0.95, 1.15),
    "net": (1.0, 1.0, 1.0),
    "racket": (1.0, 1.0, 1.0),
}
"""A blue table on a red sports floor before a grey curtain; lines, net and racket have no colour (choice)."""
BALL_TINTS: Final[dict[BallColour, Tint]] = {"orange": (1.15, 0.55, 0.10), "white": (1.05, 1.03, 0.97)}

SKIN_TINT: Final[Tint] = (1.30, 0.95, 0.75)
CLOTH_TINTS: Final[tuple[Tint, ...]] = ((1.60, 0.60, 0.55), (0.55, 1.10, 1.35), (0.75, 1.25, 0.70))
"""Red, blue and green shirts: the rules forbid the colour of the ball."""


def tinted(brightness: float, tint: Tint, channel: int) -> float:
    """A reflectance in one colour, within what a scene allows."""
    return min(1.0, max(0.01, brightness * tint[channel]))


def coloured_scenes(scene: SceneConfig, ball: BallColour) -> tuple[SceneConfig, SceneConfig, SceneConfig]:
    """The scene in red, green and blue light."""
    tints = {**TINTS, "ball": BALL_TINTS[ball]}
    red, green, blue = (
        dataclasses.replace(
            scene,
            **{name: tinted(getattr(scene, name), tint, channel) for name, tint in tints.items()},
        )
        for channel in range(3)
    )
    return red, green, blue


Array = NDArray[np.float64]

LOOK_PX: Final = 0.1
"""A part that has moved less since it was drawn last is left as it is. A blade that only turns is up to 20 levels wrong
then, in single pixels (measured)."""
PROBES: Final = 9


class FrameBodies:
    """The bodies of a scene to one colour camera, drawn in the `scenes` of its three colours."""

    def __init__(self, camera: Camera, bodies: MovingBodies, scenes: Sequence[SceneView]) -> None:
        self._camera, self._bodies, self._scenes = camera, bodies, scenes
        self._updates = self._none_yet()

    def _none_yet(self) -> TileUpdates:
        size = self._camera.sensor
        return TileUpdates.none_yet(size.width_px, size.height_px, len(self._bodies.parts))

    def instants(self, start_us: int, end_us: int, step_px: float) -> int:
        """How many steps of at most `step_px` the fastest part makes in [start, end]."""
        return steps_of_fastest(self.probe(np.linspace(start_us, end_us, PROBES)), step_px)

    def probe(self, t_us: Array) -> BodyProbes:
        """Where the bodies are at the times `t_us` (N,)."""
        return probe_bodies(self._camera, self._bodies, t_us * 1e-6)

    def cover(self, probes: BodyProbes) -> NDArray[np.bool_]:
        """(height, width): where a body may be at one of the probes."""
        size, near = self._camera.sensor, self._none_yet()
        for circles in probes.circles:
            mark_moved(circles, 0.0, near)
        tiles = near.marks.reshape(near.rows, near.columns)
        return tiles.repeat(TILE_PX, axis=0)[: size.height_px].repeat(TILE_PX, axis=1)[:, : size.width_px]

    def look(self, probes: BodyProbes, which: int, ball_m: float, boxes: NDArray[np.int64]) -> None:
        """Draw what has moved, and the boxes (K, 4): what is before the ball at `ball_m` may change there."""
        updates = self._updates
        mark_moved(probes.circles[which], LOOK_PX, updates)
        for x0, y0, x1, y1 in boxes.tolist():
            for row in range(y0 // TILE_PX, -(-y1 // TILE_PX)):
                self._list(row * updates.columns + np.arange(x0 // TILE_PX, -(-x1 // TILE_PX)))
        count, updates.listed[0] = int(updates.listed[0]), 0
        tiles = updates.tiles[:count]
        updates.marks[tiles] = False
        for scene in self._scenes:
            _draw(tiles, scene, probes.ends[which], probes.circles[which], ball_m)

    def _list(self, tiles: NDArray[np.int64]) -> None:
        updates = self._updates
        new = tiles[~updates.marks[tiles]]
        count = int(updates.listed[0])
        updates.tiles[count : count + len(new)], updates.marks[new] = new, True
        updates.listed[0] = count + len(new)


def tinted_parts(parts: Array, channel: int) -> Array:
    """The parts in red (0), green (1) or blue (2) light: skin, and shirts and shorts of a few colours."""
    skin, coloured = Clothes(shirt=0.0, shorts=0.0).skin, parts.copy()
    for row in coloured:
        grey = row[REFLECTANCE]
        tint: Tint = (1.0, 1.0, 1.0)
        if grey == skin:
            tint = SKIN_TINT
        elif row[TEXTURE] > 0:
            tint = CLOTH_TINTS[round(100 * grey) % len(CLOTH_TINTS)]
        row[REFLECTANCE] = tinted(grey, tint, channel)
    return coloured


@njit(error_model="numpy")
def _draw(tiles, scene, ends, circles, ball_m):
    posed = posed_bodies(ends, circles)
    posed_parts(scene, posed)
    for tile in tiles:
        draw_tile(tile, scene, posed, ball_m)


MIN_INSTANTS: Final = 8
"""Fewest instants rendered per exposure."""
BLUR_STEP_PX: Final = 0.7
"""Most motion between two instants, less than half an edge: a streak is right to 1.5 levels of 255 (measured)."""
BALL_DEPTH, BALL_LIGHT, RACKET_LIGHT = 2, 13, 6
"""Columns of a ball's row: camera z, and light; and the light in a racket's."""
TONES: Final = 1 << 16
"""Steps of the tone curve's table: right to half a level from 0.1 % of white on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameConfig:
    """An ordinary camera in the place of each event camera."""

    rate_hz: float = setting(60.0, 1.0, 1000.0)
    """Pictures per second."""
    exposure_us: int = setting(5000, 100, 50_000)
    """A 5 m/s ball moves by 25 mm in 5 ms, more than its radius."""
    gamma: float = setting(2.2, 1.0, 3.0)
    """Exponent of the tone curve: level = 255 light^(1 / gamma). White paper is 255, whatever the exposure: the lens is
    opened as far as that needs."""
    read_noise: float = setting(0.00025, 0.0, 0.1)
    """Standard deviation of the light that is read, as a share of white: 2.5 of 10,000 electrons, 72 dB, as in data
    sheets of machine-vision sensors. The noise of the light itself is left out: pictures would take up thrice as much
    for nothing that a detector notices."""
    ball_colour: BallColour = "orange"

    def __post_init__(self) -> None:
        check_settings(self)
        if self.exposure_us * self.rate_hz > 1e6:
            most = f"at most {1e6 / self.rate_hz:.0f} us at {self.rate_hz:g} Hz"
            raise ConfigError("an exposure is longer than a picture", expected=most, got=self.exposure_us)


class FrameCamera:
    """One colour camera. Its noise is drawn picture by picture, so that pictures are asked for in order."""

    def __init__(
        self,
        camera: Camera,
        scene: SceneConfig,
        config: FrameConfig,
        rng: np.random.Generator,
        bodies: MovingBodies | None = None,
    ) -> None:
        self.camera = camera
        self._config, self._rng = config, rng
        self._scenes = coloured_scenes(scene, config.ball_colour)
        tinted = [None if bodies is None else tinted_parts(bodies.parts, channel) for channel in range(3)]
        self._views = [
            make_scene_view(camera, own, make_background(camera, own), parts)
            for own, parts in zip(self._scenes, tinted, strict=True)
        ]
        self._still = np.stack([np.exp(view.maps[:, LOG_LIGHT]) for view in self._views], axis=1)
        self._bodies = None if bodies is None else FrameBodies(camera, bodies, self._views)
        self._tones = np.rint(255.0 * np.linspace(0.0, 1.0, TONES) ** (1.0 / config.gamma)).astype(np.uint8)

    def take(
        self, path: BallPath, racket: RacketPath | None, t_us: int, *, exposure_us: int | None = None
    ) -> NDArray[np.uint8]:
        """The picture (height, width, 3 = RGB) whose exposure has its middle at `t_us`, as long as the config says."""
        least, scene = MIN_INSTANTS, self._scenes[0]
        exposure_us = exposure_us or self._config.exposure_us
        start_us = t_us - exposure_us // 2
        end_us = start_us + exposure_us
        seen = None if racket is None else RacketView(racket, scene.racket, None)
        if self._bodies is not None:
            least = max(least, self._bodies.instants(start_us, end_us, STEP_PX))
        steps = moving_steps(self.camera, scene, path, seen, start_us, end_us, least)
        assert steps is not None, "with so many steps at least there are always some"
        instants = chosen_instants(len(steps.t_us))
        span = np.diff(steps.t_us[instants]) / (steps.t_us[-1] - steps.t_us[0])
        shares = 0.5 * (np.append(span, 0.0) + np.append(0.0, span))  # the trapezoidal rule
        shares *= np.exp(flicker_log_light(scene, steps.t_us[instants]))
        pixels, mean = self._mean_light(steps, instants, shares)
        light = self._still * np.float32(shares.sum())
        light[pixels] = mean
        return self._develop(light)

    def _mean_light(
        self, steps: Steps, instants: NDArray[np.intp], shares: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Pixels that something moves over, and their light (N, 3): so much of that at each instant."""
        swept, bodies = _swept(steps.boxes[instants], self.camera), self._bodies
        probes = None if bodies is None else bodies.probe(steps.t_us[instants])
        pixels = np.flatnonzero(swept if bodies is None or probes is None else swept | bodies.cover(probes))
        in_boxes = swept.ravel()[pixels]
        mean, see_racket = np.zeros((len(pixels), 3)), steps.outlines.shape[1] > 0
        for number, instant in enumerate(instants):
            ball, racket = steps.rows[instant].copy(), steps.rackets[instant].copy()
            if bodies is not None and probes is not None:
                ball_m = float(ball[BALL_DEPTH]) if ball[BALL_DEPTH] > 0 else np.inf
                bodies.look(probes, number, ball_m, steps.boxes[instant])
            for channel, (scene, view) in enumerate(zip(self._scenes, self._views, strict=True)):
                ball[BALL_LIGHT], racket[RACKET_LIGHT] = scene.ball, scene.racket
                moving = Moving(tuple(ball.tolist()), tuple(racket.tolist()), True, True, see_racket)
                _add_light(view, moving, shares[number], pixels, in_boxes, mean[:, channel])
        return pixels, mean

    def _develop(self, light: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Light as 8-bit levels, with what the sensor adds."""
        config, size = self._config, self.camera.sensor
        if config.read_noise:
            light += config.read_noise * self._rng.standard_normal(light.shape, np.float32)
        levels = np.empty(light.shape, np.uint8)
        _expose(light.ravel(), self._tones, levels.ravel())
        return levels.reshape(size.height_px, size.width_px, 3)


class FrameTrack:
    """Pictures of several cameras at once, at a steady rate from time 0 on."""

    def __init__(
        self,
        cameras: Mapping[str, Camera],
        scene: SceneConfig,
        config: FrameConfig,
        seed: int,
        bodies: MovingBodies | None = None,
    ) -> None:
        self.config = config
        seeds = np.random.SeedSequence([seed, 0xF4A3E5]).spawn(len(cameras))  # apart from those of the events
        self._cameras = {
            name: FrameCamera(camera, scene, config, np.random.default_rng(own), bodies)
            for (name, camera), own in zip(cameras.items(), seeds, strict=True)
        }
        self._taken = 0

    def take_until(
        self, end_us: int, path: BallPath, racket: RacketPath | None = None
    ) -> list[tuple[int, dict[str, NDArray[np.uint8]]]]:
        """The pictures, with their times at mid exposure, whose exposure is over at `end_us` and was not before."""
        found = []
        while (t_us := self._next_us()) + self.config.exposure_us - self.config.exposure_us // 2 <= end_us:
            found.append((t_us, {name: camera.take(path, racket, t_us) for name, camera in self._cameras.items()}))
            self._taken += 1
        return found

    def _next_us(self) -> int:
        return round((self._taken + 0.5) * 1e6 / self.config.rate_hz)


def chosen_instants(count: int) -> NDArray[np.intp]:
    """Which of `count` instants are enough for a picture: the events need them closer together."""
    most = max(MIN_INSTANTS, round((count - 1) * STEP_PX / BLUR_STEP_PX))
    return np.unique(np.rint(np.linspace(0, count - 1, min(most, count - 1) + 1)).astype(np.intp))


def _swept(boxes: NDArray[np.int64], camera: Camera) -> NDArray[np.bool_]:
    """(height, width): the pixels in any of the boxes (..., 4)."""
    swept = np.zeros((camera.sensor.height_px, camera.sensor.width_px), np.bool_)
    for x0, y0, x1, y1 in np.unique(boxes.reshape(-1, 4), axis=0):
        swept[y0:y1, x0:x1] = True
    return swept


@njit(error_model="numpy")
def _add_light(scene, moving, share, pixels, in_boxes, mean):
    """Add this share of the light of the pixels at one instant to their mean.

    Ball, shadow and robot's racket are looked for only where `in_boxes`.
    """
    maps, layers = scene.maps, scene.layers
    for number in range(len(pixels)):
        pixel = pixels[number]
        if not in_boxes[number]:
            among = len(layers) > 0 and (layers[pixel, NEAR_COVER] > 0.0 or layers[pixel, FAR_COVER] > 0.0)
            mean[number] += share * math.exp(layers[pixel, LOG_TOTAL] if among else maps[pixel, LOG_LIGHT])
            continue
        light, rest = light_and_rest(pixel_seen(maps, pixel), layers, pixel, scene.numbers, moving)
        mean[number] += share * (math.exp(rest) if light == UNTOUCHED else light)


@njit(error_model="numpy")
def _expose(light, tones, levels):
    for index in range(len(light)):
        levels[index] = tones[int(min(max(light[index], 0.0), 1.0) * (len(tones) - 1) + 0.5)]
