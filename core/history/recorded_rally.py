"""Predictions and decisions of a player as groups of a recording: writing and reading.

`/predictions` and `/episodes` hold what the method defines; `/racket_targets` is where the racket was sent,
`/hit_choices` where else the ball could have been hit.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from core.chain.chain import ChainState
from core.chain.control.controller import RacketDecision
from core.chain.control.hit_choice import REASONS, HitCandidate, HitChoice, nearest_reason
from core.learning.config import RewardConfig
from core.learning.task.reward import reward_weights, rewards_of
from core.live.link import messages as m
from core.physics.episode import Case
from core.physics.rotation import normals_from_orientations
from core.simulation.episodes.racket import RacketTarget
from core.table import BALL_RADIUS_M
from core.trajectory.prediction import HitPlane, Stage

Array = NDArray[np.float64]
Rows = dict[str, np.ndarray]

RACKET: Final = "/racket"
PREDICTIONS: Final = "/predictions"
TARGETS: Final = "/racket_targets"
HIT_CHOICES: Final = "/hit_choices"
EPISODES: Final = "/episodes"
SCENES_SEEN: Final = "/scenes"
"""Group of a recorded live rally that says which scene was shown from when, and who was in it."""
REWARD: Final = RewardConfig(kind="case")
"""The live rally counts no episodes, so it is the reward with constant weights."""


class HasRows(Protocol):
    """A recording in a file."""

    def read_rows(self, group: str) -> Mapping[str, np.ndarray] | None: ...


def prediction_rows(chain: ChainState, zero_us: int, rig: Collection[str] = ()) -> Rows | None:
    """One row of the newest prediction; None if the ball is not expected at the hitting plane.

    Args:
        chain: the state after the step that made the prediction.
        zero_us: time 0 of the rows on the chain's clock.
        rig: the names of all cameras. Rows that go into one file need them: a column of text has one width.
    """
    prediction, cameras = chain.prediction, "+".join(chain.predicted_from).encode()
    hit = None if prediction is None else prediction.hit_plane
    if prediction is None or hit is None:
        return None
    return {
        "t_us": np.array([prediction.t_us - zero_us]),
        "stage": np.array([hit.stage.encode()], "S4"),
        "t_hit_us": np.array([round(1e6 * hit.t_s) - zero_us]),
        "p_hit_m": hit.p_world_m[None],
        "v_hit_mps": hit.v_world_mps[None],
        "cov": hit.covariance[None],
        "cameras": np.array([cameras], f"S{len('+'.join(rig).encode()) or len(cameras)}"),
    }


def choice_rows(choice: HitChoice, zero_us: int) -> Rows | None:
    """A row for each place that was looked at, in the ball's order; None if the ball comes to none."""
    places = choice.candidates
    if not places:
        return None
    return {
        "t_us": np.full(len(places), choice.t_us - zero_us),
        "t_hit_us": np.array([round(1e6 * one.hit.t_s) - zero_us for one in places]),
        "p_hit_m": np.array([one.hit.p_world_m for one in places]),
        "sigma_m": np.array([one.hit.sigma_m for one in places]),
        "chance": np.array([one.chance for one in places]),
        "landing_sigma_m": np.array([one.landing_sigma_m for one in places]),
        "chosen": np.array([one is choice.chosen for one in places]),
        "why_not": np.array([one.why_not.encode() for one in places], "S64"),
    }


def read_choices(recording: HasRows) -> tuple[HitChoice, ...]:
    """Where balls were to be hit, in order; nothing if the recording does not say.

    Of the ball at a place the position is known with its standard deviations, and the time; all else is NaN.
    """
    rows = recording.read_rows(HIT_CHOICES)
    if rows is None or not len(rows["t_us"]):
        return ()
    each = [_place(rows, k) for k in range(len(rows["t_us"]))]
    found: list[HitChoice] = []
    for ks in np.split(np.arange(len(each)), np.flatnonzero(np.diff(rows["t_us"])) + 1):
        places = tuple(each[k] for k in ks)
        chosen = next((each[k] for k in ks if rows["chosen"][k]), None)
        why_not = "" if chosen is not None else nearest_reason([one for one in places if one.why_not])
        found.append(HitChoice(int(rows["t_us"][ks[0]]), chosen, places, why_not))
    return tuple(found)


def _place(rows: Mapping[str, np.ndarray], k: int) -> HitCandidate:
    unknown, text = np.full(3, np.nan), bytes(rows["why_not"][k]).decode("ascii", "replace")
    p, sigma, t_s = rows["p_hit_m"][k], rows["sigma_m"][k], 1e-6 * int(rows["t_hit_us"][k])
    hit = HitPlane(t_s, math.nan, p, sigma, unknown, unknown, np.full((6, 6), np.nan), "pre")
    known = text if text in REASONS else ""
    return HitCandidate(hit, float(rows["chance"][k]), float(rows["landing_sigma_m"][k]), known)


class HasRacket(Protocol):
    """A block of a live rally, sent or at its source."""

    @property
    def racket_t_us(self) -> NDArray[np.int64]: ...

    @property
    def racket(self) -> Array:
        """(M, 10) position, orientation wxyz, velocity."""
        ...


def racket_rows(state: HasRacket, zero_us: int) -> Rows:
    """Where the racket was in a block."""
    rows = state.racket
    pose = {"p_world_m": rows[:, :3], "q_world_wxyz": rows[:, 3:7], "v_world_mps": rows[:, 7:10]}
    return {"t_us": state.racket_t_us - zero_us, **pose}


def scene_rows(t_us: int, scene: str, seed: int, zero_us: int) -> Rows:
    """One row: the scene from `t_us` on; `zero_us` is the simulation's clock at time 0."""
    return {
        "t_us": np.array([t_us], np.int64),
        "zero_us": np.array([zero_us], np.int64),
        "seed": np.array([seed], np.int64),
        "name": np.array([scene.encode("ascii", "replace")], "S32"),
    }


def target_rows(decision: RacketDecision, zero_us: int) -> Rows:
    """One row."""
    target = decision.target
    return {
        "t_us": np.array([decision.t_us - zero_us]),
        "stage": np.array([decision.stage.encode()], "S4"),
        "t_hit_us": np.array([round(1e6 * target.t_s) - zero_us]),
        "p_world_m": target.p_m[None],
        "q_world_wxyz": target.q_wxyz[None],
        "v_world_mps": target.v_mps[None],
        "a": decision.action[None],
        "g": decision.goal_m[None],
    }


def episode_rows(notice: m.OutcomeNotice, decision: RacketDecision | None, policy: str, zero_us: int) -> Rows:
    """One row: what was decided on where there was a decision, else the state at the hitting plane and nothing more."""
    unknown = np.nan
    goal = np.full(2, unknown) if decision is None else decision.goal_m
    case, landing = np.array([notice.case], np.int64), np.array([notice.landing_m])
    # Without a goal only a missed ball has a reward: it does not depend on one.
    known = decision is not None or notice.case == Case.MISSED
    weights = reward_weights(0, REWARD)
    reward = rewards_of(case, landing[:, :2], np.array([notice.net_z_m]), goal[None], weights, REWARD)
    return {
        "serve_us": np.array([notice.serve_us - zero_us]),
        "speed_mps": np.array([notice.speed_mps]),
        "s": np.array([notice.arrival]) if decision is None else decision.state[None],
        "g": goal[None],
        "a": np.full((1, 3), unknown) if decision is None else decision.action[None],
        "q_wxyz": np.array([notice.q_wxyz]),
        "case": case,
        "f": landing,
        "s_next": np.array([notice.landing_m + notice.landing_v_mps]),
        "reward": reward if known else np.array([unknown]),
        "policy": np.array([policy.encode("ascii", "replace")[:32]], "S32"),
    }


def read_targets(recording: HasRows) -> tuple[RacketDecision, ...]:
    """Where the racket was sent, in order; nothing if the recording does not say.

    Of the ball's state that led to it the place is known, from where the face was to be; its velocity is NaN.
    """
    rows = recording.read_rows(TARGETS)
    if rows is None:
        return ()
    names = ("t_us", "stage", "t_hit_us", "p_world_m", "q_world_wxyz", "v_world_mps", "a", "g")
    return tuple(
        RacketDecision(
            t_us=int(t),
            stage=_stage(stage),
            state=np.concatenate([met_ball(p, q), np.full(3, np.nan)]),
            goal_m=goal,
            target=RacketTarget(p, q, v, int(t_hit) * 1e-6),
            action=action,
        )
        for t, stage, t_hit, p, q, v, action, goal in zip(*(rows[name] for name in names), strict=True)
    )


def met_ball(face_m: Array, q_wxyz: Array) -> Array:
    """(3,) centre of the ball that touches the middle of a face; inverse of `target_for_ball`."""
    return face_m + BALL_RADIUS_M * normals_from_orientations(q_wxyz)


def _stage(value: object) -> Stage:
    return "post" if value in (b"post", "post") else "pre"
