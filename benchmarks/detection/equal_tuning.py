"""One protocol of tuning for every method: the same flights, number of trials, search and objective, and one rule for
the delay.

Flights of all kinds of scenes are tuned on together, for one config of a method. Sensor and method delay an answer;
of each trial that lag is estimated on the flights tuned on and taken out before errors are compared, so no delay is
searched for. What is maximised is the mean over the kinds of F1 less 0.02 per pixel of median error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.detection.bench_drawn_scenes import Row, draw_flight
from core.cameras.presets import stereo_preset
from core.config import Setting, field_specs, get_setting, replace_setting
from core.detection import DetectorConfig, make_detector
from core.detection.methods import Method, method_config
from core.detection.window import windows_between
from core.errors import ConfigError
from core.events import Events, SensorSize
from core.metrics.delay import without_delay
from core.metrics.grid_score import GridScore, lag_ms, score_on_grid
from core.metrics.run import WindowAnswers, answer_windows, duration_of
from core.physics.config import physics_profile
from core.recordings import PixelTruth, open_recording
from core.simulation import simulate_recording
from core.tuning.objective import ANY_SPEED, WORST, figures_of
from core.tuning.parameters import choose_parameters, config_with
from core.tuning.search import Search

Kind = str
KINDS: Final[dict[Kind, tuple[Row, ...]]] = {"ball only": ("ball",), "people": ("clutter", "crossing")}
"""Kinds of scenes, and the rows that their flights are drawn from in turn."""
DELAYS: Final[dict[Method, tuple[str, str]]] = {
    "paper": ("localise", "delay_us"),
    "auto": ("localise", "delay_us"),
    "refined": ("refined", "delay_us"),
    "ebpp": ("ebpp", "delay_us"),
    "fe-fusion": ("fe_fusion", "delay_us"),
}
"""The setting of each method that its lag goes into."""
BATCH: Final = 8


@dataclass(frozen=True, slots=True, eq=False)
class FlightCamera:
    """One camera of a simulated flight, its events in memory."""

    events: Events
    truth: PixelTruth
    duration_us: int

    @property
    def sensor(self) -> SensorSize:
        """Size of the sensor."""
        return self.events.sensor

    def slice(self, start_us: int, end_us: int) -> Events:
        """The events between two times."""
        return self.events.between(start_us, end_us)


Flights = Mapping[Kind, Sequence[FlightCamera]]


def drawn_rows(kind: Kind, first: int, count: int) -> list[tuple[Row, int]]:
    """Row and number of so many flights of a kind."""
    rows = KINDS[kind]
    return [(rows[number % len(rows)], first + number) for number in range(count)]


def flight_cameras(row: Row, number: int, folder: Path) -> list[FlightCamera]:
    """Both cameras of a drawn flight before the standard sensor; its recording is made if it is not in the folder."""
    path = folder / f"{row}-{number}.h5"
    if not path.is_file():
        flight = draw_flight(row, number, any_sensor=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        half = path.with_suffix(".part.h5")  # an interrupted run leaves no recording that looks whole
        half.unlink(missing_ok=True)
        simulate_recording(
            half,
            flight.stereo,
            stereo_preset(flight.placement),
            [flight.launch],
            seed=number,
            physics=physics_profile(flight.physics),
        )
        half.replace(path)
    with open_recording(path) as recording:
        cameras = []
        for stream in recording.cameras.values():
            assert stream.truth is not None
            duration_us = duration_of(stream)
            cameras.append(FlightCamera(stream.slice(0, duration_us), stream.truth, duration_us))
    return cameras


def answers_of(camera: FlightCamera, method: Method, config: DetectorConfig) -> WindowAnswers:
    """The method's answers to a flight."""
    windows = windows_between(camera, 0, camera.duration_us, config.window.window_us)
    return answer_windows(make_detector(method, camera.sensor, config), windows, (0, camera.duration_us))


def score_answers(camera: FlightCamera, answers: WindowAnswers, near_us: int, earlier_ms: float = 0.0) -> GridScore:
    """Answers against the truth, dated back by a lag; a time is found with a right answer within half of `near_us`."""
    dated = without_delay(answers, round(1000 * earlier_ms))
    return score_on_grid(dated, camera.truth, camera.sensor, ANY_SPEED, window_us=near_us)


@dataclass(frozen=True, slots=True)
class TrialScore:
    """A config on the flights tuned on."""

    objective: float
    lag_ms: float
    """Taken out before the errors were compared: beyond the delay that the config has."""


def score_trial(flights: Flights, method: Method, config: DetectorConfig, near_us: int) -> TrialScore:
    """Mean objective over the kinds, with one lag of all of them taken out."""
    answers = {kind: [answers_of(one, method, config) for one in cameras] for kind, cameras in flights.items()}

    def scores(earlier_ms: float) -> list[GridScore]:
        return [
            sum(
                (score_answers(*pair, near_us, earlier_ms) for pair in zip(cameras, answers[kind], strict=True)),
                GridScore(),
            )
            for kind, cameras in flights.items()
        ]

    lag = lag_ms(sum(scores(0.0), GridScore()))
    return TrialScore(float(np.mean([figures_of(one).objective for one in scores(lag)])), lag)


@dataclass(frozen=True, slots=True)
class TunedMethod:
    """What the protocol made of a method."""

    method: Method
    start: DetectorConfig
    """The settings as they come, but for the delay."""
    best: DetectorConfig
    start_objective: float
    best_objective: float
    trials: int
    """Scored configs, the start among them."""
    searched: tuple[str, ...]
    """Names of the settings that were searched."""

    def delay_of(self, config: DetectorConfig) -> Setting:
        """The delay of one of its configs, us."""
        return get_setting(config, DELAYS[self.method])

    @property
    def changed(self) -> dict[str, tuple[Setting, Setting]]:
        """Value before and after of what changed."""
        pairs = {name: tuple(name.split(".")) for name in (*self.searched, ".".join(DELAYS[self.method]))}
        found = {name: (get_setting(self.start, path), get_setting(self.best, path)) for name, path in pairs.items()}
        return {name: pair for name, pair in found.items() if pair[0] != pair[1]}


def tune_equally(
    method: Method, flights: Flights, trials: int, seed: int, progress: Callable[[float], None] = lambda share: None
) -> TunedMethod:
    """The best of so many trials, the settings as they come being the first of them.

    A proposal that is impossible, or was scored before, is a trial all the same: no method gets another one for it.
    """
    start = method_config(method)
    delay = ".".join(DELAYS[method])
    parameters = [one for one in choose_parameters(method, start) if one.name != delay]
    search, near_us = Search(parameters, start, seed), start.window.window_us
    scored: dict[DetectorConfig, TrialScore] = {}
    first = best = start
    done = 0
    while done < trials:
        proposals = search.ask(1 if done == 0 else min(BATCH, trials - done))
        objectives = []
        for values in proposals:
            config = start if done == 0 else _config_with(start, values)
            if config is not None and config not in scored:
                scored[config] = score_trial(flights, method, config, near_us)
            objectives.append(WORST if config is None else scored[config].objective)
            if config is not None and scored[config].objective > scored[best].objective:
                best = config
            done += 1
            progress(done / trials)
        search.tell(objectives)
    return TunedMethod(
        method,
        with_lag(method, first, scored[first].lag_ms),
        with_lag(method, best, scored[best].lag_ms),
        scored[first].objective,
        scored[best].objective,
        trials,
        tuple(one.name for one in parameters),
    )


def with_lag(method: Method, config: DetectorConfig, lag_ms: float) -> DetectorConfig:
    """The config with this lag added to its delay, within the bounds of the setting."""
    path = DELAYS[method]
    bounds = next(one.bounds for one in field_specs(DetectorConfig) if one.path == path)
    before = get_setting(config, path)
    assert bounds is not None and isinstance(before, int)
    delay_us = round((before + 1000 * lag_ms) / bounds.step) * bounds.step
    return replace_setting(config, path, int(min(max(delay_us, bounds.low), bounds.high)))


def _config_with(start: DetectorConfig, values: Mapping[str, Setting]) -> DetectorConfig | None:
    """Config with these values; None if they do not go together."""
    try:
        return config_with(start, values)
    except ConfigError:
        return None
