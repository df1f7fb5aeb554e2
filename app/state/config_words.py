"""What a detector config is called wherever its figures are shown: its slot, and how it differs from the default."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from app.state.browser_memory import default_config, differing_settings
from app.state.client_state import SLOTS, ClientState, Slot
from core.detection import DetectorConfig
from core.detection.methods import METHODS, SECTIONS, STAGED, Method
from core.text import counted

NAMED: Final = 3
"""Most settings whose values are named."""


def changed_settings(method: Method, config: DetectorConfig) -> dict[str, object]:
    """Settings that the method takes and that are not at its default, with their values, by dotted path."""
    differing = differing_settings(config, default_config(method))
    return {name: value for name, value in differing.items() if name.partition(".")[0] in SECTIONS[method]}


def settings_words(method: Method, config: DetectorConfig) -> str:
    """Text such as "default settings" or "refined.fill_min 0.4, window.window_us 2000"."""
    changed = changed_settings(method, config)
    if not changed:
        return "default settings"
    named = [f"{name} {value_text(value)}" for name, value in list(changed.items())[:NAMED]]
    more = len(changed) - len(named)
    return ", ".join(named) + (f" and {more} more" if more else "")


def config_words(method: Method, slot: Slot, config: DetectorConfig) -> str:
    """Text such as "refined, config B (refined.fill_min 0.4)"."""
    return f"{method}, config {slot} ({settings_words(method, config)})"


def detector_words(state: ClientState) -> str:
    """What detects in every mode, such as "refined, config A (default settings)"."""
    return config_words(state.tune.method, state.tune.slot, state.config)


@dataclass(frozen=True, slots=True)
class ShowChangedConfig:
    """Show the sliders of the next config that is not the default."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        found = next_changed(changed_configs(state), state.tune.method, state.tune.slot)
        if found is None:
            return state
        return replace(state, tune=replace(state.tune, method=found.method, slot=found.slot))


@dataclass(frozen=True, slots=True)
class ChangedConfig:
    """A config of this browser that is not the default."""

    method: Method
    slot: Slot
    settings: int
    """How many settings differ."""


def changed_configs(state: ClientState) -> tuple[ChangedConfig, ...]:
    """All changed configs, over methods and slots; `auto` and `paper` share theirs, and count once."""
    found = []
    for method in METHODS:
        if method not in state.own_configs and method != shared_method():
            continue
        configs = state.history_of(method).present
        for slot in SLOTS:
            count = len(changed_settings(method, configs.of(slot)))
            found += [ChangedConfig(method, slot, count)] if count else []
    return tuple(found)


def shared_method() -> Method:
    """The method that stands for all that share their configs, in the order of the list."""
    return next(method for method in METHODS if method in STAGED)


def changed_words(changed: tuple[ChangedConfig, ...]) -> str:
    """Text such as "3 settings changed from default: A of auto (2), B of refined (1)"; empty if none is."""
    total = sum(one.settings for one in changed)
    if not total:
        return ""
    several = len(changed) > 1
    each = ", ".join(f"{one.slot} of {one.method}" + (f" ({one.settings})" if several else "") for one in changed)
    return f"{counted(total, 'setting')} changed from default: {each}"


def next_changed(changed: tuple[ChangedConfig, ...], method: Method, slot: Slot) -> ChangedConfig | None:
    """The changed config behind this one in the list, round and round; the first if this one is not in it."""
    shared = shared_method() if method in STAGED else method
    at = next((n for n, one in enumerate(changed) if (one.method, one.slot) == (shared, slot)), -1)
    return changed[(at + 1) % len(changed)] if changed else None


def value_text(value: object) -> str:
    """A setting's value, a float without needless digits."""
    return f"{value:g}" if isinstance(value, float) else str(value)
