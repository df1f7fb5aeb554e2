"""Controls of the live simulation, shared by all browsers: they show its state and send changes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import viser

from app import theme
from app.formatting import html_text, tooltip
from app.modes.mode import ModeHost, do_in_pool
from app.modes.watch.source_panel import RecordButton
from app.shared.live_rally import LiveRally
from app.shared.rallies import BUILT_IN, LEARNS, let_play, run_choices
from app.widgets import Listing, bounded, when_changed, when_clicked
from core.history.seen_outcomes import ReturnRate
from core.live.link import messages as m
from core.live.link.client import SimulationClient
from core.simulation.scenes.scene import SCENES

CELL: Final = "text-align:right;white-space:nowrap;padding-left:10px"


def returned_html(rates: tuple[ReturnRate, ...]) -> str:
    """HTML with a row for each controller and scene: share returned with its 95 % interval."""
    style = "font-size:12.5px;padding:2px 12px;line-height:1.45"
    if not rates:
        return f"<div style='{style};color:{theme.MUTED}'>No ball has been completed yet.</div>"
    rows = "".join(_row(rate) for rate in rates)
    left_out = (
        "With 95 % intervals. Balls during which controller or scene changed, and those not followed from "
        "serve to end, are not counted."
    )
    note = f"<div style='color:{theme.MUTED}'>{left_out}</div>"
    return f"<div style='{style}'><table style='width:100%'>{rows}</table>{note}</div>"


def interval_text(rate: ReturnRate) -> str:
    """The interval in whole per cent."""
    low, high = rate.interval
    return f"{100 * low:.0f}–{100 * high:.0f} %"


def _row(rate: ReturnRate) -> str:
    who = html_text(rate.conditions.controller)
    where = html_text(rate.conditions.scene or "unknown scene")
    speeds = f" · {_speeds(rate)}" if math.isfinite(rate.speeds_mps[0]) else ""
    counted = f"<b>{rate.returned} of {rate.balls}</b>, {interval_text(rate)}"
    return f"<tr><td>{who} · {where}{speeds}</td><td style='{CELL}'>{counted}</td></tr>"


def _speeds(rate: ReturnRate) -> str:
    slowest, fastest = (f"{speed:.1f}".removesuffix(".0") for speed in rate.speeds_mps)
    return f"{slowest} m/s" if slowest == fastest else f"{slowest} to {fastest} m/s"


STOP, RUN, STEP = "Pause", "Run", "+10 ms"
PACES: Final = {"real time": 1.0, "1/2": 0.5, "1/4": 0.25, "1/10": 0.1, "1/50": 0.02}
SPEEDS_MPS: Final = (3.0, 9.0)
NOISE_HZ: Final = (0.0, 5.0)
STEP_BLOCKS: Final = 1
GOAL_X_M: Final = (0.2, 1.3)
GOAL_Y_M: Final = (-0.7, 0.7)


class SimulationPanel:
    """The simulation's controls in one browser. Commands wait for their reply in the thread pool, never in the loop."""

    def __init__(self, gui: viser.GuiApi, rally: LiveRally, client: SimulationClient, host: ModeHost) -> None:
        """`client`: the connection to the simulation."""
        self._rally, self._client = rally, client
        self._host = host
        self._folder = gui.add_folder("Simulation (shared by all browsers)")
        with self._folder:
            self._serve = gui.add_button(
                "Serve", icon=viser.Icon.PING_PONG, color="teal", hint="A ball at the chosen speed"
            )
            self._speed = gui.add_slider("Serve speed [m/s]", *SPEEDS_MPS, 0.5, 5.0)
            self._auto = gui.add_checkbox("Auto-serve", True, hint=tooltip("Auto-serve"))
            self._pause = gui.add_button_group(
                "Simulation", (STOP, RUN, STEP), hint=f"+10 ms: one block. {tooltip('Block')}"
            )
            self._record = RecordButton(gui, rally, host)
            self._pace = gui.add_dropdown("Pace", tuple(PACES), hint=tooltip("Pace"))
            self._scene = gui.add_dropdown("Scene", tuple(SCENES), hint="Scenes with people need more computing time")
            self._controller = Listing(gui, "Controller", self._use, hint="Built in, learning, or a trained policy")
            with gui.add_folder("Noise and landing target", expand_by_default=False):
                self._noise = gui.add_slider(
                    "Noise [Hz/px]", *NOISE_HZ, 0.1, 0.1, hint="Background events per pixel and second"
                )
                self._goal_x = gui.add_slider("Target x [m]", *GOAL_X_M, 0.05, 0.8, hint="From the net")
                self._goal_y = gui.add_slider("Target y [m]", *GOAL_Y_M, 0.05, 0.0, hint="From the middle line")
            with gui.add_folder("Returned"):
                self._returned = gui.add_html(returned_html(()))
                self._count_anew = gui.add_button("Reset counts", icon=viser.Icon.REFRESH, hint="For all browsers")
        when_clicked(self._count_anew, rally.reset_counts)
        when_clicked(self._serve, lambda: self._ask(lambda: client.serve(self._speed.value)))
        when_changed(self._speed, lambda _: self._auto_serve() if self._auto.value else None)
        when_changed(self._auto, lambda _: self._auto_serve())
        when_changed(self._pace, lambda pace: self._ask(lambda: client.set_speed(PACES[str(pace)])))
        when_changed(self._scene, self._change_scene)
        when_changed(self._noise, lambda hz: self._ask(lambda: client.set_noise(bounded(hz, NOISE_HZ))))
        for slider in (self._goal_x, self._goal_y):
            when_changed(slider, lambda _: self._aim())

        @self._pause.on_click
        async def _(event: viser.GuiEvent) -> None:
            acts = {STOP: client.pause, RUN: client.resume, STEP: lambda: client.step(STEP_BLOCKS)}
            if event.client is not None and event.target.value in acts:
                self._ask(acts[event.target.value])

    def set_visible(self, visible: bool) -> None:
        """Show the controls only while the live rally is watched."""
        self._folder.visible = visible

    def show(self, state: m.WorldState | None) -> None:
        """Show the simulation's state and the outcomes of its balls."""
        if self._returned.content != (table := returned_html(self._rally.returns.rates())):
            self._returned.content = table
        self._record.show()
        if state is None:
            return
        if state.auto_serve_mps > 0:
            self._speed.value = state.auto_serve_mps
        self._auto.value = state.auto_serve_mps > 0
        self._pace.value = min(PACES, key=lambda name: abs(PACES[name] - state.speed_factor))
        if state.scene in SCENES:
            self._scene.value = state.scene
        self._noise.value = min(max(round(state.noise_hz, 1), NOISE_HZ[0]), NOISE_HZ[1])
        x, y = self._rally.player.snapshot.goal_m.tolist()
        self._goal_x.value, self._goal_y.value = bounded(x, GOAL_X_M), bounded(y, GOAL_Y_M)

    def show_controllers(self) -> None:
        """Offer the available controllers: reads the folder of runs."""
        learns = () if self._rally.learning.reason else (LEARNS,)
        self._controller.offer((BUILT_IN, *learns, *run_choices(self._host.services.workspace)))
        self._controller.show(self._rally.player.controller.name)

    def _use(self, name: str) -> None:
        self._ask(lambda: let_play(self._rally, self._host.services.workspace, name))

    def _change_scene(self, name: object) -> None:
        if name in SCENES:
            self._ask(lambda: self._rally.change_scene(str(name)))

    def _auto_serve(self) -> None:
        speed = bounded(self._speed.value, SPEEDS_MPS) if self._auto.value else 0.0
        self._ask(lambda: self._client.auto_serve(speed))

    def _aim(self) -> None:
        goal = bounded(self._goal_x.value, GOAL_X_M), bounded(self._goal_y.value, GOAL_Y_M)
        self._ask(lambda: self._rally.player.aim_at(goal))

    def _ask(self, act: Callable[[], object]) -> None:
        do_in_pool(self._host, act)
