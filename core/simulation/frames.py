"""Pictures of an ordinary colour camera: the same scene through the same lens, blurred by what moves while it exposes.

Linear light is averaged over instants of the exposure, closer together the faster something moves. Only pixels that
something moves over are worked on; the rest of a picture is the static room.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numba as nb
import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.config import check_settings, setting
from core.errors import ConfigError
from core.simulation.background import LOG_LIGHT, make_background
from core.simulation.colours import BallColour, coloured_scenes
from core.simulation.flight import BallPath
from core.simulation.racket_shape import RacketPath
from core.simulation.scene import SceneConfig
from core.simulation.shading import UNTOUCHED, pixel_light, pixel_seen
from core.simulation.view import STEP_PX, RacketView, Steps, moving_steps, view_numbers

LEAST_INSTANTS: Final = 8
"""Of an exposure, however little moves."""
BLUR_STEP_PX: Final = 0.7
"""Most motion between two instants, less than half an edge: a streak is right to 1.5 levels of 255 (measured)."""
BALL_LIGHT, RACKET_LIGHT = 13, 6
"""Columns of a ball's and a racket's row in which the colours differ."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameConfig:
    """An ordinary camera in the place of each event camera."""

    rate_hz: float = setting(60.0, 1.0, 1000.0)
    """Pictures per second."""
    exposure_us: int = setting(5000, 100, 50_000)
    """A 5 m/s ball moves by 25 mm in 5 ms, more than its radius."""
    gamma: float = setting(2.2, 1.0, 3.0)
    """Of the tone curve: level = 255 light^(1 / gamma). White paper is 255, whatever the exposure: the lens is opened
    as far as that needs."""
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

    def __init__(self, camera: Camera, scene: SceneConfig, config: FrameConfig, rng: np.random.Generator) -> None:
        self.camera = camera
        self._config, self._rng = config, rng
        self._scenes = coloured_scenes(scene, config.ball_colour)
        self._maps = [make_background(camera, channel) for channel in self._scenes]
        self._view = view_numbers(camera)
        self._still = np.stack([np.exp(maps[:, LOG_LIGHT]) for maps in self._maps], axis=1)

    def take(self, path: BallPath, racket: RacketPath | None, t_us: int) -> NDArray[np.uint8]:
        """The picture (height, width, 3 = RGB) whose exposure has its middle at `t_us`."""
        light = self._still.copy()
        start_us = t_us - self._config.exposure_us // 2
        end_us = start_us + self._config.exposure_us
        seen = None if racket is None else RacketView(racket, self._scenes[0].racket, None)
        steps = moving_steps(self.camera, self._scenes[0], path, seen, start_us, end_us, LEAST_INSTANTS)
        if steps is not None:
            instants = chosen_instants(len(steps.t_us))
            pixels = _swept_pixels(steps, instants, self.camera)
            for channel in range(3):
                light[pixels, channel] = self._mean_light(channel, steps, instants, pixels)
        return self._develop(light)

    def _mean_light(
        self, channel: int, steps: Steps, instants: NDArray[np.intp], pixels: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Of the pixels over the exposure, by the trapezoidal rule."""
        scene, see_racket = self._scenes[channel], steps.outlines.shape[1] > 0
        mean, span = np.zeros(len(pixels)), np.diff(steps.t_us[instants]) / (steps.t_us[-1] - steps.t_us[0])
        shares = 0.5 * (np.append(span, 0.0) + np.append(0.0, span))
        for instant, share in zip(instants, shares.tolist(), strict=True):
            ball, racket = steps.rows[instant].copy(), steps.rackets[instant].copy()
            ball[BALL_LIGHT], racket[RACKET_LIGHT] = scene.ball, scene.racket
            _add_light(
                self._maps[channel], self._view, tuple(ball.tolist()), tuple(racket.tolist()), see_racket, share,
                pixels, mean,
            )  # fmt: skip
        return mean

    def _develop(self, light: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Light as 8-bit levels, with what the sensor adds."""
        config, size = self._config, self.camera.sensor
        if config.read_noise:
            light += config.read_noise * self._rng.standard_normal(light.shape, np.float32)
        np.clip(light, 0.0, 1.0, out=light)
        levels = np.rint(255.0 * light ** np.float32(1.0 / config.gamma)).astype(np.uint8)
        return levels.reshape(size.height_px, size.width_px, 3)


class FrameTrack:
    """Pictures of several cameras at once, at a steady rate from time 0 on."""

    def __init__(self, cameras: Mapping[str, Camera], scene: SceneConfig, config: FrameConfig, seed: int) -> None:
        self.config = config
        seeds = np.random.SeedSequence([seed, 0xF4A3E5]).spawn(len(cameras))  # apart from those of the events
        self._cameras = {
            name: FrameCamera(camera, scene, config, np.random.default_rng(own))
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
    most = max(LEAST_INSTANTS, round((count - 1) * STEP_PX / BLUR_STEP_PX))
    return np.unique(np.rint(np.linspace(0, count - 1, min(most, count - 1) + 1)).astype(np.intp))


def _swept_pixels(steps: Steps, instants: NDArray[np.intp], camera: Camera) -> NDArray[np.intp]:
    """Numbers of the pixels in any box of ball, shadow and racket."""
    swept = np.zeros((camera.sensor.height_px, camera.sensor.width_px), np.bool_)
    for x0, y0, x1, y1 in np.unique(steps.boxes[instants].reshape(-1, 4), axis=0):
        swept[y0:y1, x0:x1] = True
    return np.flatnonzero(swept)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _add_light(maps, view, ball, racket, see_racket, share, pixels, mean):
    """Add this share of the light of the pixels at one instant to their mean."""
    for number in range(len(pixels)):
        seen = pixel_seen(maps, pixels[number])
        light = pixel_light(seen, view, ball, racket, True, True, see_racket)
        mean[number] += share * (np.exp(seen[LOG_LIGHT]) if light == UNTOUCHED else light)
