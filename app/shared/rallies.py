"""Rallies shared by all browsers: the live rally if there is one, and processed recordings."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

from app.shared.live_rally import LiveRally, positions
from core.cameras import Camera
from core.chain.calibration_drift import DriftReport
from core.history.following import Following, Followings, is_stereo
from core.history.rally_history import RallyHistory, RallyMoment
from core.history.rally_picture import People, RallyPicture
from core.recordings import Recording

GRACE_S: Final = 3.0
"""The live rally runs this long after the last browser left, so that reloading a page does not stop it."""


@dataclass(slots=True)
class Rallies:
    """The rallies of the app."""

    live: LiveRally | None = None
    followings: Followings = field(default_factory=Followings)
    _watched_s: float = float("-inf")

    def set_active(self, watched: bool, wall_s: float) -> None:
        """Call regularly with whether a browser is connected; without one the live rally pauses."""
        if watched:
            self._watched_s = wall_s
        if self.live is not None:
            self.live.set_active(wall_s - self._watched_s < GRACE_S)

    def of(self, recording: Recording) -> WatchedRally | None:
        """Rally of a recording; None if the recording is not stereo."""
        if self.live is not None and recording is self.live.recording:
            live = self.live
            return WatchedRally(live.history, live.cameras, live, None) if is_stereo(recording) else None
        following = self.followings.of(recording)
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

    @property
    def followed(self) -> float:
        """Share of the recording that the chain has processed."""
        return 1.0 if self.following is None else self.following.share
