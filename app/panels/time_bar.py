"""The time bar under the picture: transport controls, and a time line of the recording. Our script draws it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from app.panels.recording_info import RecordingInfo
from app.state.client_state import MODES, SPEEDS, STEPS_US, ClientState
from app.state.commands import (
    Command,
    Loop,
    Seek,
    SetMode,
    SetPlaybackSpeed,
    SetStep,
    Shuttle,
    StepTime,
    ToggleMark,
    TogglePlay,
)
from app.web.pages import Json, Message
from core.metrics import WindowVerdicts
from core.recordings import Recording
from core.recordings.truth import first_seen_us, turning_points

MOST: Final = 2_000
"""Most moments or intervals of one kind that are sent: about one per pixel of the bar."""
AFTER_FIRST_US: Final = 20_000
"""Time after which the first ball is wholly in the picture."""
MOMENTS_EVERY_S: Final = 1.0
"""Interval at which new bounces and hits of a live rally are read."""
Times = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Intervals of time with a kind each: (N,) starts, ends (exclusive) and kinds."""

    start_us: Times
    end_us: Times
    kinds: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ContactMark:
    """A bounce, hit or net touch that a person or a method names."""

    t_us: int
    sigma_us: float
    kind: str
    proposed: bool
    """It is not labelled here, but proposed, or another annotator's: it is drawn pale."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """The lines of the time line, top to bottom."""

    duration_us: int
    rates: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Events per second in bins of equal length from 0 to the end, by camera."""
    moments: Mapping[str, Times] = field(default_factory=dict)
    """Times of moments, by kind ("bounce", "hit")."""
    runs: Mapping[str, Runs] = field(default_factory=dict)
    """Intervals with their kinds, by name of the line ("labels", "detector")."""
    contacts: tuple[ContactMark, ...] = ()
    """Labelled and proposed contacts."""


def tracks_of(recording: Recording, info: RecordingInfo | None) -> Tracks:
    """Lines from the recording alone; rates come from `info`."""
    rates = {} if info is None else {name: curve.rate_hz for name, curve in info.curves.items()}
    return Tracks(recording.duration_us, rates, moments_of(recording))


def moments_of(recording: Recording) -> dict[str, Times]:
    """Bounces and hits so far, if the recording has the truth; those of a live recording grow."""
    if recording.ball is None:
        return {}
    points = turning_points(recording.ball)
    return {"bounce": points.bounces_us, "hit": points.hits_us}


def same_moments(first: Mapping[str, Times], second: Mapping[str, Times]) -> bool:
    """Whether both have the same moments."""
    return first.keys() == second.keys() and all(np.array_equal(first[kind], second[kind]) for kind in first)


def opening_us(recording: Recording) -> int:
    """Time at which a recording opens: its first ball if known, else its start."""
    seen_us = first_seen_us(stream.truth for stream in recording.cameras.values())
    return 0 if seen_us is None else min(seen_us + AFTER_FIRST_US, recording.duration_us)


def runs_of_times(t_us: Times, kinds: NDArray[np.int64], names: tuple[str, ...], width_us: int) -> Runs:
    """Times (ascending) with a kind each, joined where neighbours of one kind are no further apart than `width_us`.

    Each time stands for the `width_us` that begin with it.

    Args:
        t_us: (N,) times, ascending.
        kinds: (N,) index into `names`.
        names: of the kinds.
        width_us: how long each time stands for.
    """
    if not len(t_us):
        return Runs(t_us, t_us, ())
    new = np.ones(len(t_us), np.bool_)
    new[1:] = (np.diff(t_us) > width_us) | (kinds[1:] != kinds[:-1])
    starts = np.flatnonzero(new)
    ends = np.append(starts[1:], len(t_us)) - 1
    return Runs(t_us[starts], t_us[ends] + width_us, tuple(names[kind] for kind in kinds[starts]))


def runs_of_verdicts(verdicts: WindowVerdicts, window_us: int) -> Runs:
    """Where a detector found the ball, missed it, or saw one that was not there."""
    kinds = np.select([verdicts.false, verdicts.missed, verdicts.found], [2, 1, 0], default=-1)
    known = kinds >= 0
    return runs_of_times(verdicts.t_us[known] - window_us // 2, kinds[known], ("found", "missed", "false"), window_us)


def thinned(count: int) -> slice:
    """Indices of evenly spaced rows of `count`, at most `MOST`."""
    return slice(None, None, max(1, -(-count // MOST)))


LIVE_LENGTH_US: Final = 20_000_000
"""Length of a live recording's time line: its history of 20 s."""
FAR_US: Final = 2**52


def bar_message(state: ClientState, now_us: int, *, visible: bool, keys: bool) -> Message:
    """Message with the cursor's position and speed; `keys`: whether the bar's keys are active in this mode."""
    head = state.playhead
    start_us = max(head.start_us, head.duration_us - LIVE_LENGTH_US) if head.live else 0
    return {
        "visible": visible,
        "keys": keys,
        "now": now_us,
        "start": start_us,
        "end": max(head.duration_us, start_us + 1),
        "playing": head.playing,
        "speed": head.speed,
        "live": head.live,
        "following": head.following,
        "loop": None if head.loop_us is None else list(head.loop_us),
        "marks": list(state.marks_us),
        "step": state.step_us,
        "speeds": [[speed, speed_label(speed)] for speed in SPEEDS],
        "steps": [[step, step_label(step)] for step in STEPS_US],
    }


def tracks_message(tracks: Tracks) -> Message:
    """The lines of the time line; rates as whole numbers from 0 to 255 of their highest."""
    top = max((float(rate.max(initial=0.0)) for rate in tracks.rates.values()), default=0.0)
    rates: dict[str, Json] = {
        name: np.round(255 * rate / max(top, 1e-9)).astype(int).tolist() for name, rate in tracks.rates.items()
    }
    runs: dict[str, Json] = {}
    for name, line in tracks.runs.items():
        some = thinned(len(line.start_us))
        triples = zip(line.start_us[some].tolist(), line.end_us[some].tolist(), line.kinds[some], strict=True)
        runs[name] = [list(triple) for triple in triples]
    moments: dict[str, Json] = {kind: t_us[thinned(len(t_us))].tolist() for kind, t_us in tracks.moments.items()}
    contacts: list[Json] = [
        [mark.t_us, mark.sigma_us, mark.kind, mark.proposed] for mark in tracks.contacts[thinned(len(tracks.contacts))]
    ]
    return {
        "duration": tracks.duration_us,
        "rates": rates,
        "top_hz": top,
        "moments": moments,
        "runs": runs,
        "contacts": contacts,
    }


def command_of(message: Message) -> Command | None:
    """Command of a message from the bar; None if it is invalid. Nothing in the message is trusted."""
    value = message.get("value")
    match message.get("do"):
        case "mode" if (number := _integer(value)) is not None and 1 <= number <= len(MODES):
            return SetMode(MODES[number - 1])
        case "play":
            return TogglePlay()
        case "faster":
            return Shuttle(+1)
        case "slower":
            return Shuttle(-1)
        case "seek" if (t_us := _integer(value)) is not None:
            return Seek(t_us)
        case "step" if (steps := _integer(value)) is not None:
            # Keys that repeat while the page is busy add up.
            return StepTime(max(-1000, min(steps, 1000)))
        case "speed" if isinstance(value, (int, float)) and value in SPEEDS:
            return SetPlaybackSpeed(float(value))
        case "step_us" if (step_us := _integer(value)) is not None:
            return SetStep(step_us)
        case "mark" if (t_us := _integer(value)) is not None:
            return ToggleMark(t_us)
        case "loop" if value is None:
            return Loop(None)
        case "loop" if isinstance(value, list) and len(value) == 2:
            start_us, end_us = map(_integer, value)
            return None if start_us is None or end_us is None else Loop((start_us, end_us))
    return None


def step_label(step_us: int) -> str:
    """Readable text of a step."""
    if step_us >= 1_000_000:
        return f"{step_us // 1_000_000} s"
    return f"{step_us // 1000} ms" if step_us >= 1000 else f"{step_us} µs"


def speed_label(speed: float) -> str:
    """A speed as a factor, slow ones as a fraction."""
    return f"{speed:g} x" if speed >= 1 else f"1/{round(1 / speed)} x"


def _integer(value: object) -> int | None:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return None
    return int(max(-FAR_US, min(value, FAR_US)))


SHOW_EVERY_S: Final = 1 / 12
"""Interval of corrections while the page moves the cursor by itself."""


class BarPage(Protocol):
    """The page's interface for the bar."""

    def listen(self, kind: str, listener: Callable[[Message], None]) -> None: ...
    def send(self, kind: str, values: Message) -> None: ...


class TimeBar:
    """The time bar of one browser. All methods are called in the loop."""

    def __init__(self, page: BarPage, apply: Callable[[Command], None]) -> None:
        self._page = page
        self._apply = apply
        """At once: a key that the person pressed after it is in the queue already."""
        self._shown: Message = {}
        self._shown_s = 0.0
        self.tracks = Tracks(0)
        """The lines that are drawn."""
        self._moments_s = float("-inf")
        page.listen("bar", self._asked)

    def show(self, state: ClientState, now_us: int, wall_s: float, *, visible: bool, keys: bool) -> None:
        """Update from the state."""
        if wall_s - self._shown_s < SHOW_EVERY_S:
            return
        message = bar_message(state, now_us, visible=visible, keys=keys)
        if message != self._shown:
            self._shown, self._shown_s = message, wall_s
            self._page.send("bar", message)

    def show_tracks(self, tracks: Tracks) -> None:
        """Draw these lines, in the place of all others."""
        self.tracks = tracks
        self._page.send("tracks", tracks_message(tracks))

    def show_runs(self, name: str, runs: Runs) -> None:
        """Draw a line of this name, too, or in the place of that one."""
        self.show_tracks(replace(self.tracks, runs={**self.tracks.runs, name: runs}))

    def show_contacts(self, contacts: tuple[ContactMark, ...]) -> None:
        """Draw these contacts, in the place of the others."""
        self.show_tracks(replace(self.tracks, contacts=contacts))

    def grow(self, recording: Recording, wall_s: float) -> None:
        """Draw the bounces and hits that a live rally has had since they were last read."""
        if wall_s - self._moments_s < MOMENTS_EVERY_S:
            return
        self._moments_s, moments = wall_s, moments_of(recording)
        if not same_moments(moments, self.tracks.moments):
            self.show_tracks(replace(self.tracks, moments=moments))

    def _asked(self, message: Message) -> None:
        if (command := command_of(message)) is not None:
            self._apply(command)
