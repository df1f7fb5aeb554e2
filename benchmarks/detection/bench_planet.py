"""Methods on a real recording without labels whose truth is in the picture: a planet, and moons that move with it.

The recording is `tests/data/gen4.dat` of the source package `faery==0.7.1`: a planet through a shaking telescope, seen
by a Gen4 sensor, 10.8 s. `pip download --no-binary faery --no-deps --no-build-isolation --no-clean faery==0.7.1` brings
it (it ends with a build error, the files stay).

Two moons are points on a dark ground: their events are followed, and the planet's centre is at a constant place
between them. That place is not taken from any detector: the picture of the planet is made from the events of the first
5 s, in the frame of the moons, and the middle of its light is its centre. `docs/examples/planet.toml` was tuned on
these 5 s; what is later is scored.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from benchmarks.machine import describe_machine
from core.config import load_config
from core.detection import DetectorConfig
from core.detection.methods import Method, make_detector, method_config
from core.detection.saved import RIMLESS, load_detector
from core.errors import CommandError
from core.events import Events
from core.metrics.run import WindowAnswers, run_detector
from core.recordings import CameraStream, open_recording

CONFIG: Final = Path(__file__).parents[2] / "docs/examples/planet.toml"
STEP_US: Final = 2000
FIRST_US: Final = 50_000
"""The moons are followed from here on."""
TUNED_US: Final = 5_000_000
MOONS_PX: Final = ((562.0, 246.0), (390.0, 366.0))
"""Where they are then: the densest places beside the planet."""
STEADY_PX: Final = 5.0
"""The moons' distance from each other does not change; followed well it varies by 1.4 px."""
MOON_RADIUS_PX: Final = 9.0
HALF_US: Final = 8000
"""A moon's place is the mean of its events within this time before and after."""
FEWEST: Final = 8
DISC_PX: Final = 30.0
"""Events this near to the centre are the planet's."""
FULL_EVENTS: Final = 300
SPANS_US: Final = (1000, 16_000)
"""Windows count that have so many events on the disc in this time before their end."""
FALSE_PX: Final = 8.0


class PlanetTruth(NamedTuple):
    """The planet's centre over time."""

    t_us: NDArray[np.int64]
    centre_px: NDArray[np.float64]
    """(N, 2)."""

    def at(self, t_us: NDArray[np.int64]) -> NDArray[np.float64]:
        """(M, 2) centre at these times."""
        return np.column_stack([np.interp(t_us, self.t_us, self.centre_px[:, axis]) for axis in range(2)])


@dataclass(frozen=True, slots=True)
class Contender:
    """A method with its settings."""

    name: str
    method: Method
    config: DetectorConfig


def run(progress: Callable[[float], None], *, recorded: str | None = None) -> dict[str, object]:
    """A row per method, part of the recording and kind of window; the recording's place is `--recorded`."""
    if recorded is None:
        raise CommandError(
            "the recording of the planet is not in the repository",
            expected="the place of gen4.dat of the source package faery==0.7.1",
            remedy="`rallyscope bench planet --recorded gen4.dat`; docs/how/test-data.md has where it is from",
        )
    (stream,) = open_recording(Path(recorded)).cameras.values()
    events = stream.slice(0, 1000 * len(stream.counts_per_ms()))
    truth = planet_truth(events)
    tuned = load_config(DetectorConfig, CONFIG)
    contenders = [
        Contender("refined, planet.toml", "refined", tuned),
        Contender("refined, rimless.toml", "refined", load_detector(RIMLESS).config),
        Contender("refined", "refined", method_config("refined")),
        Contender("auto", "auto", method_config("auto")),
        Contender("fe-fusion", "fe-fusion", method_config("fe-fusion")),
    ]
    rows: list[dict[str, object]] = []
    for done, contender in enumerate(contenders):
        rows += score_planet(contender, stream, events, truth)
        progress((done + 1) / len(contenders))
    return {"rows": rows, "machine": describe_machine("numba", "numpy", clock="none: counts and pixels")}


def score_planet(
    contender: Contender, stream: CameraStream, events: Events, truth: PlanetTruth
) -> list[dict[str, object]]:
    """Rows of one method: before 5 s and after, windows with many events on the disc, and with many in 16 ms."""
    window_us = contender.config.window.window_us
    detector = make_detector(contender.method, stream.sensor, contender.config)
    answers = run_detector(stream, detector, window_us)
    places = np.column_stack([events.x_px, events.y_px]) - truth.at(events.t_us)
    disc_us = events.t_us[np.hypot(*places.T) < DISC_PX]
    rows: list[dict[str, object]] = []
    for part, first_us, end_us in (("tuned", FIRST_US, TUNED_US), ("scored", TUNED_US, int(truth.t_us[-1]))):
        for span_us in SPANS_US:
            begins = np.searchsorted(disc_us, answers.end_us - span_us)
            full = np.searchsorted(disc_us, answers.end_us) - begins >= FULL_EVENTS
            wanted = full & (first_us <= answers.end_us) & (answers.end_us < end_us)
            kind = f"{FULL_EVENTS} events in {span_us // 1000} ms"
            row: dict[str, object] = {"method": contender.name, "part": part, "windows with": kind}
            rows.append(row | _figures(answers.rows(wanted), truth))
    return rows


def _figures(answers: WindowAnswers, truth: PlanetTruth) -> dict[str, object]:
    found = answers.rows(answers.detected)
    error = np.hypot(*(np.column_stack([found.u_px, found.v_px]) - truth.at(found.t_us)).T)
    return {
        "windows": len(answers.t_us),
        "found": len(error) / len(answers.t_us) if len(answers.t_us) else math.nan,
        "rms_px": float(np.sqrt(np.mean(error**2))) if len(error) else math.nan,
        "median_px": float(np.median(error)) if len(error) else math.nan,
        "false": int((error > FALSE_PX).sum()),
    }


def planet_truth(events: Events) -> PlanetTruth:
    """Centre of the planet from its moons."""
    if not len(events) or events.t_us[-1] < TUNED_US:
        raise CommandError("the recording is too short", expected="10.8 s: gen4.dat of the source package faery==0.7.1")
    t_us = np.arange(FIRST_US, events.t_us[-1], STEP_US)
    one, other = (follow_moon(events, t_us, place) for place in MOONS_PX)
    varies_px = float((one - other).std(axis=0).max())
    if varies_px > STEADY_PX:
        raise CommandError(
            "the two moons do not move together",
            expected=f"a constant distance, within {STEADY_PX:g} px",
            got=f"{varies_px:.1f} px",
            remedy="give gen4.dat of the source package faery==0.7.1",
        )
    middle = gaussian_filter1d(0.5 * (one + other), 2.0, axis=0)
    early = t_us < TUNED_US
    offset = centre_of_light(events, PlanetTruth(t_us[early], middle[early]))
    return PlanetTruth(t_us, middle + offset)


def follow_moon(events: Events, t_us: NDArray[np.int64], place_px: tuple[float, float]) -> NDArray[np.float64]:
    """(N, 2) a moon's place at these times: the mean of the events around where it is expected."""
    place, velocity = np.array(place_px), np.zeros(2)
    places = np.empty((len(t_us), 2))
    starts, ends = np.searchsorted(events.t_us, [t_us - HALF_US, t_us + HALF_US])
    for row, (start, end) in enumerate(zip(starts, ends, strict=True)):
        seen = np.column_stack([events.x_px[start:end], events.y_px[start:end]]).astype(np.float64)
        expected = place + velocity
        for wider in (3.0, 0.0, 0.0, 0.0):
            near = np.hypot(*(seen - expected).T) < MOON_RADIUS_PX + wider
            if near.sum() < FEWEST:
                break
            expected = seen[near].mean(axis=0)
        velocity = 0.8 * velocity + 0.2 * (expected - place)
        places[row] = place = expected
    return places


def centre_of_light(events: Events, middle: PlanetTruth, half_px: int = 120) -> NDArray[np.float64]:
    """(2,) middle of the planet's light, from the middle between the moons.

    While the picture moves with the velocity v, the sum of a pixel's polarities in a short time is -v . grad(log light)
    times that time over the threshold. Least squares over all times give the gradient of every pixel in the frame of
    the moons, and its integral the picture.
    """
    within = (events.t_us >= middle.t_us[0]) & (events.t_us < middle.t_us[-1])
    t_us = events.t_us[within]
    places = np.column_stack([events.x_px[within], events.y_px[within]]) - middle.at(t_us)
    velocity = np.gradient(middle.centre_px, axis=0)
    moving = np.column_stack([np.interp(t_us, middle.t_us, velocity[:, axis]) for axis in range(2)])
    signed = np.where(events.on[within], 1.0, -1.0)
    size, reach = 2 * half_px, [[-half_px, half_px]] * 2
    sums = [
        np.histogram2d(places[:, 1], places[:, 0], size, reach, weights=signed * moving[:, axis])[0].ravel()
        for axis in range(2)
    ]
    along_u, along_v = -np.linalg.solve(velocity.T @ velocity, np.stack(sums)).reshape(2, size, size)
    wave = 2j * np.pi * np.fft.fftfreq(size)
    waves_u, waves_v = np.meshgrid(wave, wave)
    laplace = waves_u**2 + waves_v**2
    laplace[0, 0] = 1.0
    light = np.fft.ifft2((waves_u * np.fft.fft2(along_u) + waves_v * np.fft.fft2(along_v)) / laplace).real
    light -= np.median(light)
    rows, columns = np.nonzero(light > 0.5 * light.max())
    return np.array([columns.mean(), rows.mean()]) + 0.5 - half_px
