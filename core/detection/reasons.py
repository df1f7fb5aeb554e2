"""Why there is no ball, in numbers: the limits that a candidate failed, and how often each failed in a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

FIXED: Final = "fixed"
"""Stands where the setting would, for a limit that no setting moves."""


@dataclass(frozen=True, slots=True)
class Reason:
    """A limit that the nearest candidate for a ball failed in one window."""

    reason: str
    """What was measured, in a few words: "residual"."""
    setting: str | None = None
    """The setting that moves the limit, such as `refined.residual_px`; None: it is fixed."""
    value: float | None = None
    """The measured value; None where there is nothing to measure."""
    limit: float | None = None
    """The limit that the value is beyond."""
    unit: str = ""
    sentence: str = ""
    """The reason as a text, where it is not made from the fields above."""

    @property
    def text(self) -> str:
        """For a table: "residual 0.91 px > 0.55"."""
        if self.sentence:
            return self.sentence
        if self.value is None:
            return self.reason
        value, limit = number_text(self.value), "" if self.limit is None else number_text(self.limit)
        if value == limit:  # "radius 3 px < 3" would be nonsense
            value = f"{self.value:.6g}"
        text = f"{self.reason} {value}{self.unit and ' ' + self.unit}"
        return text if self.limit is None else f"{text} {'<' if self.value < self.limit else '>'} {limit}"


NO_REASON: Final = Reason("the method gives no reasons")


class Limit(NamedTuple):
    """The range that a measured value must lie in."""

    reason: str
    setting: str | None
    low: float
    high: float
    unit: str = ""

    def holds(self, value: float) -> bool:
        """Whether a value is within the limit, bounds included; not a number is not."""
        return self.low <= value <= self.high

    def failed_by(self, value: float) -> Reason:
        """The reason for a value beyond the limit."""
        limit = self.high if value > self.high else self.low
        return Reason(self.reason, self.setting, float(value), float(limit), self.unit)


def failed_limits(values: Sequence[float], limits: Sequence[Limit]) -> tuple[Reason, ...]:
    """A reason for each value that is beyond its limit, in order; both have the same length."""
    pairs = zip(values, limits, strict=True)
    return tuple(limit.failed_by(value) for value, limit in pairs if not limit.holds(value))


def reasons_of(detector: object) -> tuple[Reason, ...]:
    """Why the detector's last window had no ball.

    A detector may offer `why_not()`, see `Detector`; one that does not, or gives no reason, has `NO_REASON`.
    """
    offered: Callable[[], Iterable[Reason]] | None = getattr(detector, "why_not", None)
    return (tuple(offered()) if callable(offered) else ()) or (NO_REASON,)


@dataclass(frozen=True, slots=True)
class ReasonCount:
    """How often a limit failed in the windows without a ball."""

    reason: str
    setting: str | None
    """None: the limit is fixed."""
    windows: int
    value: float | None
    """Median of the measured values."""
    limit: float | None
    """Median of the limits: some depend on the candidate."""
    unit: str = ""
    sentence: str = ""
    """What the first of these windows says, if there was nothing to measure in any: a name alone says nothing."""

    @property
    def text(self) -> str:
        """For a table: "residual 0.91 px > 0.55"."""
        return Reason(self.reason, self.setting, self.value, self.limit, self.unit, self.sentence).text


@dataclass(slots=True)
class ReasonCounter:
    """Counts the reasons of many windows without a ball."""

    windows: int = 0
    """Windows without a ball."""
    _values: dict[tuple[str, str | None, str], list[tuple[float, float]]] = field(default_factory=dict)
    _sentences: dict[tuple[str, str | None, str], str] = field(default_factory=dict)

    def add(self, reasons: Sequence[Reason]) -> None:
        """Count a window without a ball; a reason that it names twice counts once."""
        self.windows += 1
        seen: set[tuple[str, str | None, str]] = set()
        for one in reasons:
            key = (one.reason, one.setting, one.unit)
            if key not in seen:
                seen.add(key)
                value, limit = (np.nan if number is None else number for number in (one.value, one.limit))
                self._values.setdefault(key, []).append((value, limit))
                self._sentences.setdefault(key, one.sentence)

    def counts(self) -> tuple[ReasonCount, ...]:
        """Every reason, the most frequent first."""
        found: list[ReasonCount] = []
        for key, pairs in self._values.items():
            (reason, setting, unit), (values, limits) = key, zip(*pairs, strict=True)
            value, limit = _median(values), _median(limits)
            sentence = self._sentences[key] if value is None else ""
            found.append(ReasonCount(reason, setting, len(pairs), value, limit, unit, sentence))
        return tuple(sorted(found, key=lambda one: -one.windows))


def number_text(value: float) -> str:
    """A number with three digits, a whole or large one without a fraction."""
    whole = value == round(value) if np.isfinite(value) else False
    return f"{value:.0f}" if whole or abs(value) >= 1000 else f"{value:.3g}"


def _median(column: Sequence[float]) -> float | None:
    known = [value for value in column if np.isfinite(value)]
    return float(np.median(known)) if known else None
