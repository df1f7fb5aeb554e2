"""Small additions to viser's controls."""

from __future__ import annotations

import math
import typing
from collections.abc import Callable, Mapping, Sequence

import viser
from viser import uplot

from app import theme

MARK = "● "
NOTHING = "-"


def titles_of(labels: Mapping[str, str]) -> dict[str, str]:
    """Name -> what a list of choices calls it: no two alike, and nothing of what has no label."""
    shown = list(labels.values())
    return {name: label if shown.count(label) == 1 else f"{label} ({name})" for name, label in labels.items() if label}


class Choice:
    """A row of buttons of which one is chosen and marked; viser's own does not show which."""

    def __init__(
        self, gui: viser.GuiApi, label: str, options: Sequence[str], choose: Callable[[str], None], *, hint: str = ""
    ) -> None:
        self._options = tuple(options)
        self._group = gui.add_button_group(label, self._options, hint=hint or None)
        self._shown: str | None = None

        @self._group.on_click
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                choose(str(event.target.value).removeprefix(MARK))

    @property
    def visible(self) -> bool:
        """Whether it is shown."""
        return self._group.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self._group.visible = visible

    def remove(self) -> None:
        """Take it away."""
        self._group.remove()

    def offer(self, options: Sequence[str]) -> None:
        """Offer other options; the next `show` marks one."""
        if tuple(options) != self._options:
            self._options, self._shown = tuple(options), None

    def show(self, chosen: str) -> None:
        """Mark the chosen one."""
        if chosen != self._shown:
            self._shown = chosen
            self._group.options = tuple(f"{MARK}{option}" if option == chosen else option for option in self._options)


class Listing:
    """A dropdown whose options the server changes as it finds them."""

    def __init__(self, gui: viser.GuiApi, label: str, choose: Callable[[str], None], *, hint: str = "") -> None:
        self._dropdown = typing.cast(
            "viser.GuiDropdownHandle[str]", gui.add_dropdown(label, (NOTHING,), hint=hint or None)
        )
        when_changed(self._dropdown, lambda value: choose(str(value)) if value != NOTHING else None)

    @property
    def visible(self) -> bool:
        """Whether it is shown."""
        return self._dropdown.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self._dropdown.visible = visible

    @property
    def chosen(self) -> str | None:
        """The chosen option; None while there are none."""
        return None if self._dropdown.value == NOTHING else self._dropdown.value

    def remove(self) -> None:
        """Take it away."""
        self._dropdown.remove()

    def offer(self, options: tuple[str, ...]) -> None:
        """Replace the options; the choice stays where it still is one."""
        options = options or (NOTHING,)
        if self._dropdown.options != options:
            self._dropdown.options = options

    def show(self, chosen: str) -> None:
        """Mark one as chosen."""
        if chosen in self._dropdown.options:
            self._dropdown.value = chosen


def plot_axis(unit: str, splits: tuple[float, ...] | None = None) -> uplot.Axis:
    """An axis with its unit, in the colours of the app; `splits`: the only values that have a line and a number."""
    axis = uplot.Axis(label=unit, stroke=theme.MUTED, grid={"stroke": "#333640"}, labelSize=16, size=38)
    if splits is not None:
        axis["splits"] = splits
    return axis


AXIS, GRID = "#9aa0aa", "#32363e"
"""Colours of the numbers and the lines of an axis."""


def curve_axis(size_px: int, splits: tuple[float, ...] | None = None) -> uplot.Axis:
    """Axis of a chart of curves; `splits`: the only values that have a line and a number."""
    axis = uplot.Axis(
        stroke=AXIS,
        size=size_px,
        font="11px sans-serif",
        grid={"stroke": GRID, "width": 1},
        ticks={"stroke": GRID, "width": 1, "size": 4},
    )
    if splits is not None:
        axis["splits"] = splits
    return axis


def log_scale(low: float, high: float) -> uplot.Scale:
    """A logarithmic scale of a chart.

    It is the inverse hyperbolic sine, which is a logarithm from a tenth of `low` on: what is unknown, NaN, is drawn at
    the lower end of uPlot's own logarithmic scale, and nowhere on this one.
    """
    return uplot.Scale(auto=False, range=(low, high), distr=4, asinh=low / 10, log=10)


def decades(low: float, high: float) -> tuple[float, ...]:
    """The powers of ten from `low` to `high`, for the `splits` of an axis: uPlot draws a line at each multiple, too."""
    first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
    return tuple(float(f"1e{exponent}") for exponent in range(first, last + 1))


def bounded(value: object, bounds: tuple[float, float]) -> float:
    """A number that a browser sent, within its bounds: the page keeps to them, a stranger's program need not."""
    return min(max(float(str(value)), bounds[0]), bounds[1])


def when_changed(handle: viser.GuiInputHandle, act: Callable[[object], None]) -> None:
    """Call `act(value)` for changes that a person made, in their order, and not for those that we made."""

    # Coroutines run in viser's loop, one after the other; plain functions in a pool, in any order.
    @handle.on_update
    async def _(event: viser.GuiEvent) -> None:
        if event.client is not None:
            act(event.target.value)


def when_clicked(handle: viser.GuiButtonHandle, act: Callable[[], None]) -> None:
    """Call `act()` for each click of a person."""

    @handle.on_click
    async def _(event: viser.GuiEvent) -> None:
        if event.client is not None:
            act()


def when_triggered(command: viser.CommandHandle, act: Callable[[], None]) -> None:
    """Call `act()` for each press of a command's key, and when it is chosen from the palette."""

    @command.on_trigger
    async def _(_: viser.CommandEvent) -> None:
        act()
