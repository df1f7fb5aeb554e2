"""Every setting of the chain from events to a prediction, and the physics that it expects of a ball."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field, replace
from typing import Final, Literal, get_args

from core.cameras import TriangulationConfig
from core.config import check_settings, choice, setting
from core.detection import DetectorConfig, refined_config
from core.detection.methods import METHODS, Method, method_config
from core.errors import ConfigError
from core.physics.config import PhysicsConfig
from core.physics.constants_file import FittedConstants
from core.physics.task import HIT_RULES as HIT_RULES
from core.physics.task import HitRule as HitRule
from core.table import AIR_KG_PER_M3
from core.trajectory import (
    FilterConfig,
    FilterPredictor,
    PaperPredictor,
    PaperPredictorConfig,
    Predictor,
)
from core.trajectory.config import published_predictor
from core.trajectory.filter_config import UNKNOWN, chain_filter, refined_filter, with_fitted_constants, with_physics
from core.trajectory.learned_constants import LearnedConstants

TABLE_FRICTION: Final = 0.15
"""Friction of the simulated table (choice), and what a chain expects of one."""
WINDOW_US: Final = 2000
"""Length of the windows in which the chain follows recordings and live sources: `WindowConfig` says why. A block of a
live source is a whole number of them."""


def chain_predictor() -> PaperPredictorConfig:
    """The paper's fit over the same 50 ms, of more points, and with friction at the table.

    Stereo points come every 2 ms; after the bounce of a fast ball there is time for three at 10 ms, but for ten of
    these.
    `PaperPredictorConfig()` is the paper's own.
    """
    return PaperPredictorConfig(friction=TABLE_FRICTION, observations=12, spacing_ms=4.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackGateConfig:
    """Which points belong to one flight, and when a new one begins."""

    gap_ms: float = setting(100.0, 5.0, 2000.0)
    """So long without a point, and the next one begins a new flight (choice)."""
    max_speed_mps: float = setting(25.0, 1.0, 100.0)
    """A point that the ball could reach only faster is not of this flight (choice; serves have 3 to 9 m/s)."""
    tolerance_m: float = setting(0.06, 0.0, 1.0)
    """Besides, points may lie so far apart by their noise (choice)."""
    restart_points: int = setting(3, 1, 50)
    """So many points in a row that are no part of the flight, but of one another, begin a new one (choice)."""
    turn_m: float = setting(0.06, 0.01, 1.0)
    """A ball that has come back so far from its nearest point to the robot was struck: its flight is over (choice)."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeCheckConfig:
    """Whether circles have the size of a ball at their depth. The paper has no such check: off with its detector."""

    enabled: bool = True
    """Drop circles of a wrong size, and look for the ball among the other circles of the window."""
    smallest: float = setting(0.75, 0.0, 1.0)
    """Least radius over the expected one (our measurement: shadows have 0.4 to 0.7)."""
    largest: float = setting(1.7, 1.0, 10.0)
    """Greatest; a fast ball's circle holds its motion too (our measurement: 1.65 at 9 m/s)."""
    patience: int = setting(3, 1, 100)
    """Windows in a row with a wrong circle and no other, before the whole sensor is searched (as after misses)."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleViewConfig:
    """When the detection of one camera alone moves the flight. Only with the prediction `filter`."""

    least_cameras: int = setting(3, 2, 100)
    """Rigs of fewer cameras do without: the answers of a pair stay those of earlier versions."""
    longest_ms: float = setting(100.0, 0.0, 1000.0)
    """So long after the last point of several cameras (choice)."""
    floor_px: float = setting(0.1, 0.0, 10.0)
    """Added to the sigma of the pixel: no calibration is better (choice, as in the triangulation)."""
    gate_sigmas: float = setting(5.0, 1.0, 20.0)
    """A pixel farther from the expected one is of something else (choice: a right one in 300,000)."""
    offset_mm: float = setting(0.12, 0.0, 100.0)
    """Common vertical error of all points of a flight (standard deviation), which the filter cannot see: light from
    above moves the ball's picture up or down in every camera. Nothing moves it sideways in all of them; there the
    filter's own covariance is right. By 12 simulated serves of 5 to 9 m/s before four cameras."""
    offset_mmps: float = setting(1.0, 0.0, 1000.0)
    """Growth of that error since several cameras saw the ball (standard deviation): the velocity errs with the points.
    By the same serves."""
    delay_us: float = setting(50.0, 0.0, 10_000.0)
    """The sensor's delay is known to so much (standard deviation, as in the filter's `ahead_m`, which is a length that
    holds for 6 m/s): a faster ball may be farther ahead, and that is added along the flight."""
    largest_sigma_mm: float = setting(5.0, 0.1, 1000.0)
    """A place known less well along its worst direction is not given as a point (choice)."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainConfig:
    """Detector, triangulation, flight, prediction; `of_method` has what goes with another detector."""

    method: Method = choice("refined", METHODS)
    """The detector."""
    detector: DetectorConfig = field(default_factory=refined_config)
    triangulation: TriangulationConfig = field(default_factory=TriangulationConfig)
    size: SizeCheckConfig = field(default_factory=SizeCheckConfig)
    flight: TrackGateConfig = field(default_factory=TrackGateConfig)
    prediction: Literal["filter", "fit"] = "filter"
    """`filter`: every point counts, as `filter` says; `fit`: gravity through the newest points, as `predictor` says."""
    predictor: PaperPredictorConfig = field(default_factory=chain_predictor)
    """Its hitting plane is that of the filter too."""
    filter: FilterConfig = field(default_factory=refined_filter)
    single_view: SingleViewConfig = field(default_factory=SingleViewConfig)
    max_lag_ms: float = setting(6.0, 0.1, 100.0)
    """A camera is read between two of its detections only if they are no farther apart: three windows of 2 ms."""

    def __post_init__(self) -> None:
        check_settings(self)

    @classmethod
    def of_method(cls, method: Method, detector: DetectorConfig | None = None) -> ChainConfig:
        """The chain made for a method: `refined` has a filter of its own."""
        chosen = method_config(method, detector)
        return cls(method=method, detector=chosen, filter=refined_filter() if method == "refined" else chain_filter())

    @property
    def estimates_spin(self) -> bool:
        """Whether its predictions hold the ball's spin."""
        return self.prediction == "filter"

    def make_predictor(self) -> Predictor:
        """A predictor as these settings say."""
        if self.prediction == "filter":
            return FilterPredictor(self.filter, hit_x_m=self.predictor.hit_x_m)
        return PaperPredictor(self.predictor)


PredictionName = Literal["filter", "paper"]
PREDICTIONS: Final[tuple[PredictionName, ...]] = get_args(PredictionName)
"""`filter`: every point of the flight. `paper`: the published fit of five points before, then after the bounce."""


def with_prediction(chain: ChainConfig, name: PredictionName) -> ChainConfig:
    """The chain with another prediction; its detector stays.

    Raises:
        ConfigError: if there is no such prediction.
    """
    if name == "paper":
        return dataclasses.replace(chain, prediction="fit", predictor=published_predictor())
    if name == "filter":
        return dataclasses.replace(chain, prediction="filter", predictor=chain_predictor())
    raise ConfigError("no such prediction", expected=" or ".join(PREDICTIONS), got=repr(name)[:40])


def published_chain() -> ChainConfig:
    """The paper's detector and prediction, and nothing that the paper has not."""
    return with_prediction(ChainConfig.of_method("paper"), "paper")


def expected_physics(physics: PhysicsConfig) -> PhysicsConfig:
    """Air and table of which nobody said anything, as published of any; the racket is one's own, and is known."""
    return _with(physics, UNKNOWN["drag"], UNKNOWN["magnus"], UNKNOWN["restitution"], UNKNOWN["friction"])


def learned_physics(learned: LearnedConstants, physics: PhysicsConfig) -> PhysicsConfig:
    """Air and table as the balls so far have them; the racket of `physics`."""
    drag, restitution, friction = learned.means.tolist()
    there = learned.air > 0.5
    return _with(physics, drag if there else 0.0, UNKNOWN["magnus"] if there else 0.0, restitution, friction)


def _with(physics: PhysicsConfig, drag: float, magnus: float, restitution: float, friction: float) -> PhysicsConfig:
    air = replace(physics.air, drag_coefficient=drag, magnus_coefficient=magnus, density_kg_per_m3=AIR_KG_PER_M3)
    table = replace(physics.table, restitution=restitution, restitution_loss_s_per_m=0.0, friction=friction)
    return replace(physics, air=air, table=table)


def chain_for_physics(chain: ChainConfig, physics: PhysicsConfig) -> ChainConfig:
    """The chain with air and table of `physics`; its own settings where that is the paper's: they are made for it."""
    if physics == PhysicsConfig():
        return replace(chain, filter=replace(chain.filter, perhaps_real=False))
    air, table = physics.air, physics.table
    ball = replace(
        with_physics(chain.filter, "real" if physics.has_air else "paper"),
        drag=air.drag_coefficient,
        magnus=air.magnus_coefficient,
        restitution=table.restitution,
        friction=table.friction,
        perhaps_real=False,
    )
    fit = replace(chain.predictor, restitution=table.restitution, friction=table.friction)
    return replace(chain, predictor=fit, filter=ball)


def chain_with_constants(chain: ChainConfig, constants: FittedConstants) -> ChainConfig:
    """The chain whose filter begins with fitted constants; the paper's fit keeps those that were published with it."""
    return replace(chain, filter=fitted_filter(chain.filter, constants))


def fitted_filter(config: FilterConfig, constants: FittedConstants) -> FilterConfig:
    """The filter that begins with fitted constants, see `with_fitted_constants`."""
    drag, restitution, friction = constants.drag_coefficient, constants.restitution, constants.friction
    return with_fitted_constants(config, drag, restitution, friction, constants.magnus_coefficient)
