"""Rallies shared by all browsers: the live rally if there is one, and processed recordings; and trained policies
that can play the live rally or replay balls.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal, get_args

from app.shared.frame_detector import frame_detector
from app.shared.live_rally import LiveRally, positions
from app.shared.workspace import Workspace
from core.cameras import Camera
from core.chain.calibration_drift import DriftReport
from core.chain.config import PredictionName
from core.chain.control.controller import BuiltInController
from core.errors import CommandError
from core.history.following import Following, Followings, is_stereo
from core.history.rally_history import BALL_US, RallyHistory, RallyMoment
from core.history.rally_picture import People, RallyPicture
from core.learning.runs.policy_controller import load_controller
from core.online_learning.controller import NAME
from core.online_learning.start import NOTHING, LearningStart, can_start_from, start_from_nothing, start_from_run
from core.recordings import Recording
from core.recordings.frames import FrameStream

GRACE_S: Final = 3.0
"""The live rally runs this long after the last browser turned away, so that reloading a page does not stop it."""


@dataclass(slots=True)
class Rallies:
    """The rallies of the app."""

    live: LiveRally | None = None
    followings: Followings = field(default_factory=Followings)
    prediction: PredictionName = "filter"
    """Prediction that recordings are followed with unless a browser chooses another."""
    _watched_s: float = float("-inf")

    def __post_init__(self) -> None:
        self.followings.frame_detector = frame_detector()

    def set_active(self, watched: bool, wall_s: float) -> None:
        """Call regularly with whether a browser watches the live rally; it pauses while nobody needs it."""
        if watched:
            self._watched_s = wall_s
        if self.live is not None:
            self.live.set_active(wall_s - self._watched_s < GRACE_S)

    def of(self, recording: Recording, prediction: PredictionName | None = None) -> WatchedRally | None:
        """Rally of a recording, with another prediction if given; None if the recording is not stereo.

        All browsers share the prediction of the live rally, see `LiveRally.predict_with`.
        """
        if self.live is not None and recording is self.live.recording:
            live = self.live
            return WatchedRally(live.history, live.cameras, live, None) if is_stereo(recording) else None
        following = self.followings.of(recording, prediction or self.prediction)
        return None if following is None else WatchedRally(following.history, following.cameras, None, following)

    def close(self) -> None:
        """Stop processing recordings."""
        self.followings.close()
        if self.live is not None:
            self.live.close()


@dataclass(frozen=True, slots=True, eq=False)
class WatchedRally:
    """One rally in 3D."""

    history: RallyHistory
    cameras: dict[str, Camera]
    live: LiveRally | None
    """The live rally; None for a recording."""
    following: Following | None

    @property
    def frames(self) -> dict[str, FrameStream]:
        """Pictures of the frame cameras that are followed, by camera; of a live rally those that are remembered."""
        if self.live is not None:
            return self.live.frames
        return {} if self.following is None else self.following.frames

    def people(self, t_us: int) -> People | None:
        """Simulated persons at a time, if known."""
        if self.live is not None:
            return self.live.bodies.at(t_us)
        return None if self.following is None else self.following.bodies.at(t_us)

    def picture_of(self, moment: RallyMoment) -> RallyPicture:
        """Picture of a moment for the 3D scene."""
        picture = replace(moment.picture, people=self.people(moment.t_us))
        if self.live is None or not self.live.has_robot:
            return picture
        return replace(picture, landing_target=self.live.player.snapshot.goal_m)

    def picture_at(self, t_us: int) -> RallyPicture:
        """Picture at a time for the 3D scene."""
        return self.picture_of(self.history.at(t_us, positions(self.cameras)))

    @property
    def drift(self) -> DriftReport:
        """Whether the cameras fit each other."""
        if self.live is not None:
            return self.live.drift
        return DriftReport() if self.following is None else self.following.drift.report

    def has_reached(self, t_us: int) -> bool:
        """Whether the chain has processed this time: up to where a ball would be drawn at it."""
        is_complete = self.live is None and self.followed >= 1  # its last window ends before the recording does
        return is_complete or t_us <= self.history.followed_us + BALL_US

    @property
    def followed(self) -> float:
        """Share of the recording that the chain has processed."""
        return 1.0 if self.following is None else self.following.share


Player = Literal["training ball", "current policy", "best so far"]
PLAYERS: Final[tuple[Player, ...]] = get_args(Player)
BUILT_IN: Final = BuiltInController().name
LEARNS: Final = NAME


def run_choices(workspace: Workspace) -> tuple[str, ...]:
    """Names of the runs with a policy, newest first."""
    found = []
    for name in workspace.run_names():
        run = workspace.run_path(name)
        times = [_changed_s(path) for path in run.glob("seed-*/policy.safetensors")]
        if times:
            found.append((max(times), name))
    return tuple(name for _, name in sorted(found, reverse=True))


def has_policy(workspace: Workspace, name: str) -> bool:
    """Whether a run has a policy."""
    return any(workspace.run_path(name).glob("seed-*/policy.safetensors"))


def let_play(live: LiveRally, workspace: Workspace, name: str) -> None:
    """Let the built-in controller, the policy that learns, or that of a run play the live rally from the next block on.

    It aims where the one before it aimed. Reads a file: not to be called by the loop.

    Raises:
        RallyscopeError: if there is no such run, or its policy cannot be read.
    """
    goal = live.player.snapshot.goal_m
    if name == BUILT_IN:
        live.player.use(BuiltInController().aimed_at(goal))
    elif name == LEARNS:
        live.learning.begin()
    elif name in run_choices(workspace):  # never a path made from what a browser sent
        controller = load_controller(workspace.run_path(name), goal_m=goal)
        if controller.needs_spin and not live.player.config.chain.estimates_spin:
            remedy = "use the filter, or a policy trained without --state spin"
            raise CommandError("this policy needs the ball's spin, which the chain does not estimate", remedy=remedy)
        live.player.use(controller)
    else:
        raise CommandError("no policy to play with", got=repr(name[:80]), remedy="train one in the mode Train")


def start_choices(workspace: Workspace) -> tuple[str, ...]:
    """Starting points for online learning: untrained, or a run that can be resumed, newest first."""
    return (NOTHING, *(name for name in run_choices(workspace) if can_start_from(workspace.run_path(name))))


def learning_start(workspace: Workspace, name: str) -> LearningStart:
    """Load a starting point. Reads files: not to be called by the loop.

    Raises:
        RallyscopeError: if there is no such run, or it cannot be gone on with.
    """
    if name == NOTHING:
        return start_from_nothing()
    if name not in run_choices(workspace):  # never a path made from what a browser sent
        raise CommandError("no run to start from", got=repr(name[:80]), remedy="train one in the mode Train")
    return start_from_run(workspace.run_path(name))


def _changed_s(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
