"""The thresholds of a method that can be searched for, by names such as `cluster.eps_px`, and the scale of each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from core.config import (
    FieldSpec,
    Setting,
    config_from_mapping,
    config_to_mapping,
    field_specs,
    get_section,
    get_setting,
    replace_setting,
)
from core.detection import DetectorConfig
from core.detection.detector import DETECTORS
from core.detection.methods import SECTIONS, method_config, method_named
from core.errors import ConfigError

USUAL: Final[Mapping[str, tuple[str, ...]]] = DETECTORS.view(lambda one: one.usual, where=lambda one: bool(one.usual))
"""What is searched for unless told otherwise: that which decides what a ball is. A method that is not here has all of
its own sections. The length of a window is in none: it is also a matter of latency."""
LARGEST_POWER: Final = 4.0


@dataclass(frozen=True, slots=True)
class Parameter:
    """One threshold. A number has a scale from 0 to 1 on which its default is near the middle or above.

    A bound far above the default would otherwise take most of the scale: value = low + (high - low) * place^power.
    """

    spec: FieldSpec

    @property
    def name(self) -> str:
        """Such as `cluster.eps_px`."""
        return ".".join(self.spec.path)

    @property
    def choices(self) -> tuple[bool, ...] | tuple[str, ...] | None:
        """Possible values of a switch or a choice; None for a number."""
        return (False, True) if self.spec.kind is bool else self.spec.choices or None

    @property
    def power(self) -> float:
        """Exponent of the scale; 1 is linear."""
        low, span, default = self._range()
        share = (default - low) / span
        return min(LARGEST_POWER, max(1.0, math.log(share) / math.log(0.5))) if share > 0 else LARGEST_POWER

    def place_of(self, value: float) -> float:
        """Where a value is on the scale, 0 to 1."""
        low, span, _ = self._range()
        return ((value - low) / span) ** (1 / self.power)

    def value_at(self, place: float) -> int | float:
        """The value at a place of the scale, on a whole step from the lower bound."""
        low, span, _ = self._range()
        bounds = self.spec.bounds
        assert bounds is not None
        steps = min(round(span * place**self.power / bounds.step), math.floor(span / bounds.step + 1e-9))
        value = low + steps * bounds.step
        return int(value) if self.spec.kind is int else float(f"{value:.10g}")  # 0.1 + 2 * 0.05 is 0.2 here

    def _range(self) -> tuple[float, float, float]:
        bounds, default = self.spec.bounds, self.spec.default
        assert bounds is not None and isinstance(default, (int, float))
        return bounds.low, bounds.high - bounds.low, default


def choose_parameters(method: str, start: DetectorConfig, names: Iterable[str] | None = None) -> tuple[Parameter, ...]:
    """The parameters of those names, or the usual ones of the method, in the config's order.

    A name is that of a field, `cluster.eps_px`, or of a section, `cluster`, for all of its fields.

    Raises:
        ConfigError: for a name that there is not, and for a field of a stage that is switched off.
        CommandError: if there is no such method.
    """
    offered = {parameter.name: parameter for parameter in tunable_parameters(method, start)}
    if names is None:
        own = [name for name in offered if not name.startswith("window.")]
        wanted = {name for name in USUAL.get(method, own) if name in offered and _is_on(start, name)}
    else:
        wanted = set()
        for name in names:
            fields = [one for one in offered if name in (one, one.partition(".")[0])]
            if not fields:
                known = ", ".join(offered)
                raise ConfigError(f"the method {method!r} has no parameter {name!r}", expected=f"one of {known}")
            wanted.update(fields)
        for name in wanted:
            switch = f"{name.partition('.')[0]}.enabled"
            if not _is_on(start, name) and switch not in wanted:
                remedy = f"switch it on in the config to start from, or tune {switch} too"
                raise ConfigError(f"{name} does nothing while {switch} is false", remedy=remedy)
    return tuple(parameter for name, parameter in offered.items() if name in wanted)


def tunable_parameters(method: str, start: DetectorConfig) -> tuple[Parameter, ...]:
    """All settings that the method uses, without those it fixes itself.

    Raises:
        CommandError: if there is no such method.
    """
    sections = SECTIONS[method_named(method)]
    specs = [spec for spec in field_specs(DetectorConfig) if spec.path[0] in sections and not spec.is_list]
    obeyed = [spec for spec in specs if _is_obeyed(method, start, spec)]
    fixed = {spec.path for spec in specs} - {spec.path for spec in obeyed}
    off = {section for section, name in fixed if name == "enabled"}
    return tuple(Parameter(spec) for spec in obeyed if spec.path[0] not in off)


def config_with(start: DetectorConfig, values: Mapping[str, Setting]) -> DetectorConfig:
    """The config with these values by name, all at once: on the way from one to the next it might be impossible.

    Raises:
        ConfigError: if they do not go together.
    """
    mapping = config_to_mapping(start)
    for name, value in values.items():
        section, _, field = name.partition(".")
        table = mapping.setdefault(section, {})  # a registered section with its defaults
        assert isinstance(table, dict)
        table[field] = value
    return config_from_mapping(DetectorConfig, mapping, where="tuning")


def _is_obeyed(method: str, start: DetectorConfig, spec: FieldSpec) -> bool:
    """Whether the method uses this setting."""
    bounds = spec.bounds
    values = Parameter(spec).choices or ((spec.kind(bounds.low), spec.kind(bounds.high)) if bounds else ())
    for value in values:
        try:
            config = replace_setting(start, spec.path, value)
        except ConfigError:  # not with the others
            continue
        if get_setting(method_config(method, config), spec.path) != value:
            return False
    return True


def _is_on(config: DetectorConfig, name: str) -> bool:
    return bool(getattr(get_section(config, name.partition(".")[0]), "enabled", True))
