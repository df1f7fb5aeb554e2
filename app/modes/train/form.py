"""A new training: presets, and every field of `RunConfig` as a form."""

from __future__ import annotations

import dataclasses
import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Final

import viser

from app.panels.field_control import add_field_control, section_title
from app.widgets import when_changed, when_clicked
from core.config import FieldSpec, config_from_mapping, config_to_mapping, field_specs, get_setting
from core.errors import ConfigError
from core.learning.config import CurriculumConfig, RunConfig, StateSource, default_run
from core.learning.registered_agents import AGENTS, AgentName

MAX_STAGES: Final = 10
MAX_EPISODES: Final = 20_000
"""Most episodes of one stage that a browser may start."""
MAX_SEEDS: Final = 50
EVALUATIONS_PER_STAGE: Final = 10
"""Fewest evaluations per stage: a short stage is evaluated more often than every 50 episodes."""
SB3_NEEDS: Final = ("stable_baselines3", "sb3_contrib")
SOURCES: Final[tuple[StateSource, ...]] = ("predicted", "truth", "truth+noise")
"""State sources that are offered. Not `events`, which takes a second per ball: use the command line."""
PACES: Final[dict[str, float | None]] = {
    "as fast as possible": None,
    "20 balls a second": 20.0,
    "5 balls a second": 5.0,
    "2.5 balls a second": 2.5,
    "1 ball a second": 1.0,
}
"""Choices of the speed control."""


@dataclass(frozen=True, slots=True)
class Preset:
    """A run config with a name and a speed."""

    slug: str
    """Prefix of its runs' names."""
    config: RunConfig
    pace: str = "as fast as possible"


def _landing_model(*speeds_mps: float, episodes: int = 100, source: StateSource = "truth") -> RunConfig:
    run = default_run("landing-model")
    stages = dataclasses.replace(run.curriculum, speeds_mps=speeds_mps, episodes=(episodes,) * len(speeds_mps))
    environment = dataclasses.replace(run.environment, state_source=source)
    return dataclasses.replace(run, environment=environment, curriculum=stages)


TRAIN_NOW: Final = "Learn to place balls in a minute"
THE_CURRICULUM: Final = "The paper: 800 balls at 3 m/s, 900 at 5 m/s"
PRESETS: Final[dict[str, Preset]] = {
    TRAIN_NOW: Preset("first", _landing_model(5.0), "2.5 balls a second"),
    THE_CURRICULUM: Preset("paper", default_run("ddpg")),
    "The paper's agent straight at 5 m/s": Preset(
        "scratch", RunConfig(curriculum=CurriculumConfig(speeds_mps=(5.0,), episodes=(1700,)))
    ),
    "Landing model: 300 balls at 5 m/s": Preset("model", _landing_model(5.0, episodes=300)),
    "Landing model: curriculum to 9 m/s": Preset("curriculum", _landing_model(5.0, 6.0, 7.0, 8.0, 9.0)),
    "Landing model, noisy perception": Preset("noisy", _landing_model(5.0, episodes=300, source="truth+noise")),
    "For comparison: TD3 at 5 m/s": Preset("td3", default_run("td3")),
}


CUSTOM: Final = "custom"
"""Shown in place of a preset that was changed."""


def offered_agents() -> tuple[AgentName, ...]:
    """Agents that can be trained here; some need stable-baselines3."""
    has_sb3 = all(importlib.util.find_spec(name) is not None for name in SB3_NEEDS)
    return tuple(name for name, agent in AGENTS.items() if has_sb3 or not agent.trains_itself)


def offered_presets() -> tuple[str, ...]:
    """Names of the presets whose agents can be trained here."""
    agents = offered_agents()
    return tuple(name for name, preset in PRESETS.items() if preset.config.agent in agents)


def startable_run(config: RunConfig) -> RunConfig:
    """The run that a browser starts: short stages are evaluated more often.

    Raises:
        ConfigError: if it is more than a browser may ask for.
    """
    curriculum, source = config.curriculum, config.environment.state_source
    if config.agent not in offered_agents():
        raise ConfigError("not offered", expected=", ".join(offered_agents()), got=config.agent, where="agent")
    if source not in SOURCES:
        raise ConfigError("not offered", expected=", ".join(SOURCES), got=source, where="state source")
    if len(curriculum.speeds_mps) > MAX_STAGES:
        raise ConfigError("not a curriculum", expected=f"1 to {MAX_STAGES} speeds", where="speeds")
    if max(curriculum.episodes) > MAX_EPISODES:
        raise ConfigError("too many", expected=f"1 to {MAX_EPISODES} a stage", where="episodes")
    if config.seeds > MAX_SEEDS:
        raise ConfigError("too many", expected=f"1 to {MAX_SEEDS}", got=config.seeds, where="seeds")
    every = max(1, min(config.checkpoint_every, min(curriculum.episodes) // EVALUATIONS_PER_STAGE))
    return dataclasses.replace(config, checkpoint_every=every)


Path = tuple[str, ...]

MAIN: Final[tuple[Path, ...]] = (
    ("agent",),
    ("reward", "kind"),
    ("curriculum", "speeds_mps"),
    ("curriculum", "episodes"),
    ("curriculum", "advance"),
    ("curriculum", "replay"),
    ("environment", "state_source"),
    ("seeds",),
    ("first_seed",),
)
"""Main fields; all others are folded away."""
NOT_HERE: Final = (("environment", "task"), ("environment", "recorded"))
LONGEST_NUMBER: Final = 12
LARGEST_WHOLE: Final = 2.0**53
"""Largest whole number that a browser's floats represent exactly."""


def form_specs() -> tuple[FieldSpec, ...]:
    """The fields of the form, the main ones first; the physics of the task is the simulation's and no part of it, and
    files of recorded balls are for the command line.
    """
    specs = {spec.path: spec for spec in field_specs(RunConfig) if spec.path[:2] not in NOT_HERE}
    offered = {("agent",): offered_agents(), ("environment", "state_source"): SOURCES}
    for path, choices in offered.items():
        specs[path] = dataclasses.replace(specs[path], choices=choices)
    return (*(specs.pop(path) for path in MAIN), *specs.values())


def value_shown(config: RunConfig, spec: FieldSpec) -> bool | int | float | str:
    """The value of a field as its control shows it: equal numbers of a list once."""
    value = get_setting(config, spec.path)
    if not isinstance(value, tuple):
        return value
    shown = value[:1] if len(set(value)) == 1 else value
    return ", ".join(f"{number:g}" for number in shown)


def agent_defaults(agent: str) -> dict[Path, bool | int | float | str]:
    """What the folded fields show when an agent is chosen: its defaults. The main ones stay what the person made them.

    Raises:
        ConfigError: if there is no such agent.
    """
    specs = form_specs()
    run = default_run(_value(specs[0], agent))  # type: ignore[arg-type]
    return {spec.path: value_shown(run, spec) for spec in specs[len(MAIN) :]}


def run_of_form(base: RunConfig, values: Mapping[Path, object]) -> RunConfig:
    """`base` with the values of the form, which may be anything.

    Raises:
        ConfigError: if a value is none that its field can have, or they do not go together.
    """
    mapping = config_to_mapping(base)
    specs = {spec.path: spec for spec in form_specs()}
    for path, value in values.items():
        where: dict = mapping
        for name in path[:-1]:
            where = where.setdefault(name, {})  # a registered section with its defaults
        where[path[-1]] = _value(specs[path], value)
    curriculum = mapping["curriculum"]
    assert isinstance(curriculum, dict)
    if len(curriculum["episodes"]) == 1:  # one number applies to all stages
        curriculum["episodes"] = curriculum["episodes"] * len(curriculum["speeds_mps"])
    return config_from_mapping(RunConfig, mapping, where="the form")


def _value(spec: FieldSpec, value: object) -> object:
    if spec.is_list:
        return _numbers(spec, str(value))
    if spec.kind is int and isinstance(value, float) and value.is_integer() and abs(value) < LARGEST_WHOLE:
        return int(value)
    if spec.choices and value not in spec.choices:
        expected = ", ".join(spec.choices)
        raise ConfigError("not offered", expected=expected, got=repr(value)[:80], where=spec.path[-1])
    return value


def _numbers(spec: FieldSpec, text: str) -> tuple[float, ...]:
    """Numbers of a typed list such as "3, 5"."""
    parts = text[: 2 * MAX_STAGES * LONGEST_NUMBER].replace(",", " ").split()
    try:
        if not 1 <= len(parts) <= MAX_STAGES or any(len(part) > LONGEST_NUMBER for part in parts):
            raise ValueError(text)
        return tuple(spec.kind(part) for part in parts)
    except ValueError:
        expected = f"1 to {MAX_STAGES} numbers, such as 3, 5"
        raise ConfigError(
            "not a list of numbers", expected=expected, got=repr(text[:80]), where=spec.path[-1]
        ) from None


class FormPanel:
    """The form of one browser; `start(name, config, place)` and `choose(preset)` are called in the loop."""

    def __init__(
        self,
        gui: viser.GuiApi,
        start: Callable[[str, RunConfig, str], None],
        choose: Callable[[Preset], None],
        later: Callable[[Callable[[], None]], None],
        places: tuple[str, ...],
    ) -> None:
        self._start = start
        self._choose = choose
        self._preset = gui.add_dropdown("Preset", (*offered_presets(), CUSTOM), hint="Fills in all settings below")
        specs = form_specs()
        self._specs = {spec.path: spec for spec in specs}
        self._handles = {spec.path: add_field_control(gui, spec) for spec in specs[: len(MAIN)]}
        with gui.add_folder("Every other setting", expand_by_default=False):
            for section, fields in groupby(specs[len(MAIN) :], lambda spec: spec.path[:-1]):
                with gui.add_folder(section_title(section), expand_by_default=False):
                    self._handles |= {spec.path: add_field_control(gui, spec) for spec in fields}
        self._name = gui.add_text("Name", "", hint="Name of the run; empty: chosen automatically")
        self._place = gui.add_dropdown(
            "Where", places, visible=len(places) > 1, hint="Machine that trains several seeds in parallel"
        )
        button = gui.add_button("Start", icon=viser.Icon.PLAYER_PLAY)
        when_changed(self._preset, lambda name: later(lambda: self._use(str(name))))
        for path, handle in self._handles.items():
            if path != ("agent",):
                when_changed(handle, lambda _: later(self._name_preset))
        when_changed(self._handles[("agent",)], lambda agent: later(lambda: self._use_agent(str(agent))))
        when_clicked(button, lambda: later(self._send))
        self._fill(PRESETS[TRAIN_NOW])

    @property
    def preset(self) -> Preset:
        """Preset that was chosen last."""
        return self._chosen

    def _use(self, name: str) -> None:
        if name in offered_presets():
            self._fill(PRESETS[name])
            self._choose(PRESETS[name])
        else:
            self._name_preset()

    def _use_agent(self, agent: str) -> None:
        for path, value in agent_defaults(agent).items():
            self._handles[path].value = value
        self._name_preset()

    def _name_preset(self) -> None:
        """Show the preset that the form holds; `custom` once a value was changed, until it is changed back."""
        name = next(name for name, preset in PRESETS.items() if preset is self._chosen)
        held = all(
            handle.value == value_shown(self._chosen.config, self._specs[path])
            for path, handle in self._handles.items()
        )
        self._preset.value = name if held else CUSTOM

    def _fill(self, preset: Preset) -> None:
        self._chosen = preset
        for path, handle in self._handles.items():
            handle.value = value_shown(preset.config, self._specs[path])

    def _send(self) -> None:
        values = {path: handle.value for path, handle in self._handles.items()}
        self._start(str(self._name.value), run_of_form(self._chosen.config, values), str(self._place.value))
