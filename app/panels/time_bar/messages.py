"""What the page is told about time, and what it may ask for. Pure."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from app.panels.time_bar.tracks import Tracks, thinned
from app.state.client_state import MODES, ClientState
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
from app.state.playback import SPEEDS, STEPS_US
from app.web.pages import Json, Message

LIVE_LENGTH_US: Final = 20_000_000
"""The time line of a live recording spans the last 20 s, which is what it remembers."""
FAR_US: Final = 2**52


def bar_message(state: ClientState, now_us: int, *, visible: bool, keys: bool) -> Message:
    """Where the cursor is and how it moves; `keys`: the bar's keys are its own in this mode."""
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
    return {"duration": tracks.duration_us, "rates": rates, "top_hz": top, "moments": moments, "runs": runs}


def command_of(message: Message) -> Command | None:
    """What the bar asks for; None for what it cannot mean. Nothing in the message is trusted."""
    value = message.get("value")
    match message.get("do"):
        case "mode" if (number := _whole(value)) is not None and 1 <= number <= len(MODES):
            return SetMode(MODES[number - 1])
        case "play":
            return TogglePlay()
        case "faster":
            return Shuttle(+1)
        case "slower":
            return Shuttle(-1)
        case "seek" if (t_us := _whole(value)) is not None:
            return Seek(t_us)
        case "step" if (steps := _whole(value)) is not None:
            return StepTime(max(-1000, min(steps, 1000)))
        case "speed" if isinstance(value, (int, float)) and value in SPEEDS:
            return SetPlaybackSpeed(float(value))
        case "step_us" if (step_us := _whole(value)) is not None:
            return SetStep(step_us)
        case "mark" if (t_us := _whole(value)) is not None:
            return ToggleMark(t_us)
        case "loop" if value is None:
            return Loop(None)
        case "loop" if isinstance(value, list) and len(value) == 2:
            start_us, end_us = map(_whole, value)
            return None if start_us is None or end_us is None else Loop((start_us, end_us))
    return None


def step_label(step_us: int) -> str:
    """A step as people say it."""
    if step_us >= 1_000_000:
        return f"{step_us // 1_000_000} s"
    return f"{step_us // 1000} ms" if step_us >= 1000 else f"{step_us} µs"


def speed_label(speed: float) -> str:
    """A speed as a factor, slow ones as a fraction."""
    return f"{speed:g} x" if speed >= 1 else f"1/{round(1 / speed)} x"


def _whole(value: object) -> int | None:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return None
    return int(max(-FAR_US, min(value, FAR_US)))
