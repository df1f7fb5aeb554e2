"""The place of the hit over one flight: chosen now and then, kept where another one would cost more than it gains."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, Protocol, runtime_checkable

from core.chain.control.hit_choice import (
    FaceTrajectory,
    HitChoice,
    HitChoiceConfig,
    RacketReach,
    StrokeModel,
    choose_hit,
)
from core.trajectory import Prediction
from core.trajectory.prediction import HitPlane, Stage

CHOOSE_AGAIN_US: Final = 30_000
"""The place of the hit is looked for again after so long, and after the bounce (choice: it costs a millisecond)."""
LAST_SWITCH_S: Final = 0.15
"""So short before the hit its place is kept: another one, however good, would cost the motion so far (choice)."""
COMMAND_S: Final = 0.02
"""From the end of a window until the racket moves by it (our measurement: 18 ms)."""


@runtime_checkable
class ChoosesHit(Protocol):
    """A controller that may meet a ball elsewhere than at the paper's plane."""

    def strokes(self) -> StrokeModel | None:
        """How a ball would be hit at several places; None for one that only knows the plane."""
        ...


class HitSelector:
    """Chooses for one ball after the other; `forget_flight` between two."""

    def __init__(self, config: HitChoiceConfig | None = None) -> None:
        self._config = config or HitChoiceConfig()
        self.forget_flight()

    def forget_flight(self) -> None:
        """Expect a new ball."""
        self.choice: HitChoice | None = None
        """The newest choice for this ball; None at the paper's plane."""
        self._stage: Stage | None = None
        self._kept_x_m: float | None = None

    def place(
        self,
        prediction: Prediction,
        model: StrokeModel,
        racket: Callable[[], FaceTrajectory],
        reach: RacketReach,
        bounces_us: Sequence[int],
    ) -> HitPlane | None:
        """Where the ball is hit: as chosen, or, where no stroke returns it, as before or at the prediction's plane.

        Args:
            prediction: the flight.
            model: how a ball is hit somewhere.
            racket: tells where the face is when a command of now takes effect; asked only if a place is looked for.
            reach: what the racket can do.
            bounces_us: bounces of the flight seen so far.
        """
        before, kept_x_m = self.choice, self._kept_x_m
        at_kept = None if kept_x_m is None else prediction.crossings([kept_x_m])[0]
        if at_kept is not None and at_kept.t_s - prediction.t_us * 1e-6 < LAST_SWITCH_S:
            return at_kept
        fresh = before is not None and prediction.t_us - before.t_us < CHOOSE_AGAIN_US
        if fresh and self._stage == prediction.stage and (at_kept is not None or kept_x_m is None):
            return at_kept or prediction.hit_plane
        self.choice = choose_hit(
            prediction,
            model,
            racket(),
            reach,
            self._config,
            bounced_s=1e-6 * bounces_us[-1] if bounces_us else None,
            kept_x_m=kept_x_m,
        )
        self._stage = prediction.stage
        chosen = self.choice.chosen
        if chosen is None:  # the racket goes on as it was sent, or waits where the paper's would be
            return at_kept or prediction.hit_plane
        self._kept_x_m = float(chosen.hit.p_world_m[0])
        return chosen.hit
