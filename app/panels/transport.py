"""Time: play, pause, step, speed, scrub."""

from __future__ import annotations

from collections.abc import Callable

import viser

from app.state.client_state import ClientState
from app.state.commands import Command, Seek, SetPlaybackSpeed, SetStep, StepTime, TogglePlay
from app.state.playback import SPEEDS, STEPS_US
from app.widgets import when_changed, when_clicked

SLIDER_STEP_S = 0.001
LIVE_LENGTH_US = 20_000_000
"""The slider of a live recording spans the last 20 s, which is what it remembers."""


class TransportPanel:
    """The time controls of one browser, for a recording of one length."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Command], None]) -> None:
        self._gui = gui
        self._send = send
        self.folder = gui.add_folder("Time")
        with self.folder:
            self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, hint="Space", order=1)
            self._steps = gui.add_button_group("Go", ("Start", "-10", "-1", "+1", "+10", "End"), order=2)
            with gui.add_folder("Exact time, step and speed", expand_by_default=False, order=3):
                self._number = gui.add_number("Time [µs]", 0, min=0, step=1, hint="End of the shown window")
                self._step = gui.add_dropdown("Step", [step_label(step) for step in STEPS_US], hint="Of +1 and -1")
                self._speed = gui.add_dropdown(
                    "Speed", [speed_label(speed) for speed in SPEEDS], hint="Recording time over wall time"
                )
        self._slider: viser.GuiSliderHandle[float] | None = None
        self._slider_length_us = -1
        self._behind_us = 0
        self._shown_playing = False
        when_clicked(self._play, lambda: send(TogglePlay()))
        when_changed(self._step, lambda value: send(SetStep(_lookup(STEPS_US, step_label, value))))
        when_changed(self._speed, lambda value: send(SetPlaybackSpeed(_lookup(SPEEDS, speed_label, value))))
        when_changed(self._number, lambda value: send(Seek(int(str(value)))))

        @self._steps.on_click
        async def _(event: viser.GuiEvent) -> None:
            go = str(event.target.value)
            if go == "Start":
                send(Seek(0))
            elif go == "End":
                send(Seek(2**62))
            else:
                send(StepTime(int(go)))

    def show(self, state: ClientState, now_us: int) -> None:
        """Follow the state; the slider is made anew when the recording's length changes."""
        head = state.playhead
        length_us = LIVE_LENGTH_US if head.live else head.duration_us
        self._behind_us = max(0, head.duration_us - length_us)
        if length_us != self._slider_length_us:
            self._make_slider(length_us, "Last 20 s" if head.live else "Time [s]")
        assert self._slider is not None
        if head.playing != self._shown_playing:
            self._shown_playing = head.playing
            self._play.label = "Pause" if head.playing else "Play"
            self._play.icon = viser.Icon.PLAYER_PAUSE if head.playing else viser.Icon.PLAYER_PLAY
        at_s = max(0, now_us - self._behind_us) / 1e6
        self._slider.value = min(round(at_s / SLIDER_STEP_S) * SLIDER_STEP_S, self._slider.max)
        self._number.value = now_us
        self._step.value = step_label(state.step_us)
        self._speed.value = speed_label(min(SPEEDS, key=lambda speed: abs(speed - head.speed)))

    def _make_slider(self, duration_us: int, label: str) -> None:
        if self._slider is not None:
            self._slider.remove()
        self._slider_length_us = duration_us
        length_s = max(duration_us / 1e6, SLIDER_STEP_S)
        with self.folder:
            self._slider = self._gui.add_slider(label, 0.0, length_s, SLIDER_STEP_S, 0.0, order=0)
        when_changed(self._slider, lambda value: self._send(Seek(self._behind_us + round(float(str(value)) * 1e6))))


def step_label(step_us: int) -> str:
    """A step as people say it."""
    if step_us >= 1_000_000:
        return f"{step_us // 1_000_000} s"
    return f"{step_us // 1000} ms" if step_us >= 1000 else f"{step_us} µs"


def speed_label(speed: float) -> str:
    """A speed as a factor, slow ones as a fraction."""
    return f"{speed:g} x" if speed >= 1 else f"1/{round(1 / speed)} x"


def _lookup(values: tuple, label: Callable, text: object):
    return next(value for value in values if label(value) == text)
