"""What the values of a table mean: the unit of its times and its polarities, told from all of its rows.

The file's own words come first (the name of a column), then what a person states, then what the values can only be.
What is taken for granted is said in a note; what cannot be told is refused, and an option is named that states it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.foreign_tables import FEW_ODD, UNIT_NAMES, UNITS_US, allowed_odd
from core.recordings.layout import MAX_TIME_US
from core.recordings.sources.source import (
    POLARITY,
    TIME_UNIT,
    Columns,
    DecodeReport,
    Fact,
    FactOrigin,
    ImportOptions,
    RawColumns,
)
from core.recordings.sources.table_columns import addresses_from_column, has_fractions
from core.recordings.sources.values.assumed_sizes import AddressCounts

CLOCK_BITS: Final = (24, 31, 32)
"""Lengths of clocks that begin again at 0."""
_EPOCHS: Final = (("ns", 1e17, 1e19), ("us", 1e14, 1e17), ("ms", 1e12, 3e12), ("s", 1e9, 3e9))
"""Times since 1970 of today, by unit."""
_SLOW_HZ: Final = 50.0
_LONG_US: Final = 60e6
_SHORT_US: Final = 5e3
_MANY_ROWS: Final = 1000
_ALIKE_ROWS: Final = 20
"""So few events may really have one time, and so many at each of all times not."""
_LONGEST_STEP_US: Final = 1000.0
_FINE_STEP_US: Final = 10.0
"""Steps of times as the clocks of cameras have them."""
_MAX_VALUES: Final = 1000
_WORDS: Final = {
    "true": True, "on": True, "pos": True, "positive": True, "+": True, "up": True, "t": True, "p": True,
    "false": False, "off": False, "neg": False, "negative": False, "-": False, "down": False, "f": False, "n": False,
}  # fmt: skip
_NUMBERS: Final[tuple[dict[float, bool], ...]] = (
    {0.0: False, 1.0: True},
    {-1.0: False, 1.0: True},
    {0.0: False, 255.0: True},
    *({2.0**bits - 1: False, 1.0: True} for bits in (8, 16, 32, 64)),
)
"""Pairs of values with one meaning; the last ones are -1 in a column that has no sign."""


@dataclass(slots=True)
class TableSummary:
    """What the rows of a table have in common; a few odd ones among them do not change it."""

    rows: int = 0
    polarities: dict[str | float, int] = field(default_factory=dict)
    """Value -> how often."""
    fractions: int = 0
    """Times that are no whole numbers."""
    no_thousands: int = 0
    """Times that are no multiples of 1000."""
    no_thousandths: int = 0
    """Times that are no multiples of 0.001."""
    low_t: float = np.inf
    high_t: float = -np.inf
    steps_t: float = 0.0
    """Sum of the steps from row to row but for the largest: pauses, strays, and clocks that begin again."""
    spacing_t: float = 0.0
    """Step between neighbouring numbers at the latest time, of times in 32 or fewer bits with fractions; else 0."""
    finest_t: float = np.inf
    """Smallest step between rows of different times."""
    short_clock: bool = False
    """Whether the times are whole numbers of 16 bits or fewer that step back."""
    bytes_x: bool = False
    bytes_y: bool = False
    """Whether addresses are in 8 bits without a sign."""
    between_pixels: bool = False
    """Whether there are addresses with fractions, as of undistorted events."""
    addresses: AddressCounts = field(default_factory=AddressCounts)

    @property
    def whole(self) -> bool:
        """Whether the times are whole numbers."""
        return self._is_few(self.fractions)

    @property
    def thousands(self) -> bool:
        """Whether the times are multiples of 1000."""
        return self._is_few(self.no_thousands)

    @property
    def thousandths(self) -> bool:
        """Whether the times are multiples of 0.001."""
        return self._is_few(self.no_thousandths)

    @property
    def span_t(self) -> float:
        """How long the events take, in the unit of their times."""
        return max(0.0, min(self.high_t - self.low_t, self.steps_t)) if self.rows else 0.0

    def _is_few(self, count: int) -> bool:
        return count <= min(allowed_odd(self.rows), self.rows // 4)

    def add(self, part: RawColumns) -> None:
        """Take in some rows."""
        if not len(part.t):
            return
        self.rows += len(part.t)
        finite = part.t[np.isfinite(part.t)] if part.t.dtype.kind == "f" else part.t
        self._add_times(finite)
        values, counts = np.unique(part.p, return_counts=True)
        for value, count in zip(values.tolist()[:_MAX_VALUES], counts.tolist(), strict=False):
            key = value.decode("latin-1") if isinstance(value, bytes) else value
            key = _key(key) if isinstance(key, str) else float(key)
            self.polarities[key] = self.polarities.get(key, 0) + count
        self.bytes_x, self.bytes_y = part.x.dtype == np.uint8, part.y.dtype == np.uint8
        self.between_pixels |= has_fractions(part.x) or has_fractions(part.y)
        self.addresses.add(addresses_from_column(part.x), addresses_from_column(part.y))

    def _add_times(self, t: NDArray) -> None:
        count = len(t)
        if not count:
            return
        odd = min(max(FEW_ODD, count // 200), (count - 1) // 4)  # times that may lie apart from the others
        low, high = np.partition(t, (odd, count - 1 - odd))[[odd, count - 1 - odd]]
        self.low_t, self.high_t = min(self.low_t, float(low)), max(self.high_t, float(high))
        if count > 1:
            steps = np.diff(t.astype(np.float64))
            self.short_clock |= t.dtype.kind in "iu" and t.dtype.itemsize <= 2 and bool((steps < 0).any())
            steps = np.abs(steps)
            self.finest_t = min(self.finest_t, float(np.min(steps, where=steps > 0, initial=np.inf)))
            self.steps_t += float(np.partition(steps, count - 2 - odd)[: count - 1 - odd].sum())
        if t.dtype.kind == "f" and t.dtype.itemsize <= 4:
            self.spacing_t = max(self.spacing_t, float(np.spacing(np.abs(t).max())))
        whole = t == np.floor(t) if t.dtype.kind == "f" else np.ones(count, np.bool_)
        self.fractions += count - int(np.count_nonzero(whole))
        self.no_thousands += int(np.count_nonzero(t % 1000 != 0))
        self.no_thousandths += 0 if whole.all() else int(np.count_nonzero(~_are_thousandths(t)))


def _are_thousandths(t: NDArray) -> NDArray[np.bool_]:
    """Which of the times (N,) have at most three digits after the point, but for the rounding of their text."""
    with np.errstate(over="ignore", invalid="ignore"):  # damage
        steps = 1e3 * t.astype(np.float64)
        return np.abs(steps - np.rint(steps)) < 1e-3


def summarise_table(parts: Iterable[RawColumns]) -> TableSummary:
    """Look at all rows once."""
    seen = TableSummary()
    for part in parts:
        seen.add(part)
    return seen


@dataclass(frozen=True, slots=True)
class TableInterpretation:
    """How the rows of a table are read."""

    unit: str
    on: Mapping[str | float, bool]

    @property
    def clock_lengths_us(self) -> tuple[int, ...]:
        """Value of the clocks that may have begun again, in whole microseconds."""
        return tuple(round((1 << bits) * UNITS_US[self.unit]) for bits in CLOCK_BITS)

    def columns(self, part: RawColumns) -> tuple[Columns, int]:
        """The rows in microseconds and polarities, and how many were left out because their values are odd."""
        on, known = _polarity_column(part.p, self.on)
        t = part.t
        longest = 2**62 / max(1.0, UNITS_US[self.unit])
        # What is no number is not less than anything; float16 holds nothing beyond 65504.
        with np.errstate(invalid="ignore", over="ignore"):
            known &= (t < longest) & (t > -longest)
        odd = len(t) - int(np.count_nonzero(known))
        x, y = addresses_from_column(part.x), addresses_from_column(part.y)
        if odd:
            t, x, y, on = t[known], x[known], y[known], on[known]
        return Columns(in_us(t, self.unit), x, y, on), odd


def in_us(t: NDArray, unit: str) -> NDArray[np.int64]:
    """Times of a unit in whole microseconds."""
    if t.dtype.kind == "f":
        return np.rint(t.astype(np.float64) * UNITS_US[unit]).astype(np.int64)
    t = t.astype(np.int64)
    return t // 1000 if unit == "ns" else t * int(UNITS_US[unit])


def interpret_table(
    seen: TableSummary, hint: str | None, report: DecodeReport, *, where: str, unit_from: FactOrigin = FactOrigin.FILE
) -> TableInterpretation:
    """What the values mean; `hint` is the unit that the file itself, or as `unit_from` says its format, states.

    Raises:
        RecordingError: if it cannot be told.
    """
    _refuse_lost_times(seen, where)
    _refuse_shares(seen, where)
    unit = _unit(seen, hint, unit_from, report, where)
    _check_steps(seen, unit, report, where)
    if seen.between_pixels:
        text = "addresses have fractions, as of undistorted events; the nearest pixels are kept"
        report.notes.append(f"{where}: {text}.")
    on = _polarity(seen, report.options, report, where)
    return TableInterpretation(unit, on)


def _refuse_lost_times(seen: TableSummary, where: str) -> None:
    """Refuse times that lost digits where the file was written: their high ones in 16 bits, or, of times since 1970,
    their low ones in 32 bits or in a few digits of text.

    Raises:
        RecordingError: if no time of an event can be told.
    """
    what = "the times were rounded where the file was written"
    if seen.short_clock:  # rows would be sorted as if they came late: they lie within the clock's length
        remedy = "write the times in 32 bits or more, with the laps of the clock counted"
        what = "the times are whole numbers of 16 bits, and step back: they begin again every 65,536"
        raise RecordingError(what, where=where, remedy=remedy)
    since_1970 = any(low <= seen.low_t and seen.high_t < high for _, low, high in _EPOCHS)
    alike = seen.rows > _ALIKE_ROWS and seen.low_t == seen.high_t
    if not since_1970 or not (seen.spacing_t or alike):
        return
    got = f"all {seen.rows:,} events at {seen.low_t:.10g}, which counts from 1970" if alike else "32 bits"
    if seen.spacing_t:
        got = f"times since 1970 as float32, which holds them in steps of {seen.spacing_t:g}"
    remedy = "write them as whole numbers or as float64, or take the first time from them before"
    raise RecordingError(what, got=got, where=where, remedy=remedy)


def _refuse_shares(seen: TableSummary, where: str) -> None:
    """Refuse addresses that are shares of the picture: rounded, they would be the pixels of one corner."""
    if seen.between_pixels and seen.rows > _ALIKE_ROWS and max(seen.addresses.largest) <= 1:
        raise RecordingError(
            "the addresses are shares of the picture, where pixels belong",
            got=f"all {seen.rows:,} events within a pixel of the corner, with fractions",
            where=where,
            remedy="multiply x by the width and y by the height",
        )


def _check_steps(seen: TableSummary, unit: str, report: DecodeReport, where: str) -> None:
    """Say if all events have one time, or if 32 bits hold the times in large steps.

    Raises:
        RecordingError: if these steps are longer than a millisecond.
    """
    step_us = seen.spacing_t * UNITS_US[unit]
    if step_us > _LONGEST_STEP_US:
        got = f"steps of {step_us / 1e3:g} ms at {seen.high_t:.10g} in {UNIT_NAMES[unit]} as float32"
        what, remedy = "the times are too coarse", "write them as whole numbers or as float64"
        raise RecordingError(what, got=got, where=where, remedy=remedy)
    if step_us > _FINE_STEP_US:
        report.notes.append(f"{where}: its times are float32, which holds the last ones in steps of {step_us:.3g} us.")
    between_ms = seen.finest_t * UNITS_US[unit] / 1e3
    if seen.rows > _ALIKE_ROWS and seen.low_t == seen.high_t and not seen.steps_t:
        report.assume(f"{where}: all {seen.rows:,} events have one time, {seen.low_t:.10g}; were the times rounded?")
    elif 1e3 * between_ms > _LONGEST_STEP_US and seen.rows > _ALIKE_ROWS * (1 + seen.span_t / seen.finest_t):
        text = f"{seen.rows:,} events have few times, {between_ms:g} ms or more apart; were the times rounded?"
        report.assume(f"{where}: {text}")


def _unit(seen: TableSummary, hint: str | None, unit_from: FactOrigin, report: DecodeReport, where: str) -> str:
    stated = report.options.time_unit
    if stated is None and hint is not None and hint not in UNITS_US:
        expected, remedy = ", ".join(UNITS_US), "give --time-unit with the one that it is"
        raise RecordingError(
            "the file states another unit of time", expected=expected, got=repr(hint[:40]), where=where, remedy=remedy
        )
    if stated is not None or hint is not None or not seen.rows:
        unit = stated or hint or "us"
        origin = FactOrigin.OPTION if stated else unit_from if hint is not None else FactOrigin.ASSUMED
        report.facts[TIME_UNIT] = Fact(UNIT_NAMES[unit], origin)
        if stated is not None and hint not in (None, stated):
            report.assume(f"{where}: its times are read as {UNIT_NAMES[unit]} (--time-unit), though it says {hint}.")
        elif hint is not None:
            _check_stated_unit(seen, hint, report, where)
        return unit
    unit, why = _unit_by_values(seen, where)
    report.facts[TIME_UNIT] = Fact(UNIT_NAMES[unit], FactOrigin.ASSUMED, why)
    report.assume(f"{where} does not name the unit of its times; {UNIT_NAMES[unit]} are assumed: {why}.")
    return unit


def _unit_by_values(seen: TableSummary, where: str) -> tuple[str, str]:
    """The unit that the times themselves are likely to have, and why."""
    # Whole seconds since 1970 would leave one time for thousands of events; they are microseconds since the start.
    epoch = next((unit for unit, low, high in _EPOCHS if low <= seen.low_t and seen.high_t < high), None)
    if epoch is not None and not (epoch == "s" and seen.whole) and not (epoch == "ms" and _us_is_likelier(seen)):
        return epoch, "they count from 1970"
    if seen.whole:
        return "us", _why_microseconds(seen, where)
    _check_seconds(seen, where)
    return "s", "they have fractions"


def _why_microseconds(seen: TableSummary, where: str) -> str:
    """Why whole numbers are microseconds, and what speaks against it.

    Raises:
        RecordingError: if too much does.
    """
    span = seen.span_t
    slow = span > _LONG_US and seen.rows < _SLOW_HZ * span / 1e6
    if seen.thousands and slow and seen.rows > 20:
        raise RecordingError(
            "the unit of the times cannot be told: as microseconds the file would be implausibly long",
            got=f"{seen.rows:,} events in {span / 1e6:,.0f} s, every time a multiple of 1000 as of nanoseconds",
            where=where,
            remedy="give --time-unit ns, or --time-unit us",
        )
    why = "they are whole numbers"
    if slow:
        return why + f", though only {1e6 * seen.rows / span:.1f} events/s; nanoseconds would be --time-unit ns"
    if seen.thousands and seen.rows > 20 and seen.high_t > 0:
        return why + ", though all are multiples of 1000; nanoseconds would be --time-unit ns"
    if seen.rows > _MANY_ROWS and span < _SHORT_US:
        return why + f", though all lie within {span / 1e3:g} ms; milliseconds would be --time-unit ms"
    return why


def _check_seconds(seen: TableSummary, where: str) -> None:
    """Hold times with fractions against a recording's length, were they seconds.

    Raises:
        RecordingError: if they are likelier milliseconds, or would last days.
    """
    span_us = seen.span_t * UNITS_US["s"]
    slow = seen.thousandths or seen.rows < _SLOW_HZ * seen.span_t
    # Milliseconds with fractions and no unit: TimoStoff/events_contrast_maximization#12.
    if span_us > _LONG_US and slow and seen.rows > 20:
        raise RecordingError(
            "the unit of the times cannot be told: as seconds the file would be implausibly long",
            got=f"{seen.rows:,} events in {seen.span_t:,.0f} s"
            + (", every time a multiple of 0.001 as of milliseconds" if seen.thousandths else ""),
            where=where,
            remedy="give --time-unit ms, or --time-unit s",
        )
    if span_us > MAX_TIME_US:
        raise RecordingError(
            "the unit of the times cannot be told: as seconds the file would last days",
            got=f"times with fractions from {seen.low_t:g} to {seen.high_t:g}",
            where=where,
            remedy="give --time-unit ns, us or ms",
        )


def _check_stated_unit(seen: TableSummary, unit: str, report: DecodeReport, where: str) -> None:
    """Hold the unit that a file states against its times.

    Raises:
        RecordingError: if the file would last days, or less than a millisecond in times with fractions.
    """
    span_us = seen.span_t * UNITS_US[unit]
    # Seconds in a column called t_us.
    if unit in ("us", "ns") and not seen.whole and span_us < _LONGEST_STEP_US and seen.rows > _ALIKE_ROWS:
        raise RecordingError(
            f"the times cannot be {UNIT_NAMES[unit]}, which the file states",
            expected="whole numbers, or times over more than a millisecond",
            got=f"{seen.rows:,} events from {seen.low_t:g} to {seen.high_t:g}",
            where=where,
            remedy="give --time-unit with the right one",
        )
    # An attribute "s" beside whole microseconds: tub-rip/events_h52bag#6.
    if span_us > MAX_TIME_US:
        raise RecordingError(
            f"the times cannot be {UNIT_NAMES[unit]}, which the file states",
            expected="less than a day",
            got=f"{seen.rows:,} events in {span_us / 1e6:,.0f} s",
            where=where,
            remedy="give --time-unit with the right one",
        )
    if seen.rows > FEW_ODD and span_us > _LONG_US and seen.rows < _SLOW_HZ * span_us / 1e6:
        text = f"only {1e6 * seen.rows / span_us:.1f} events/s over {span_us / 1e6:,.0f} s"
    elif seen.rows > _MANY_ROWS and 0 < span_us < _SHORT_US:
        text = f"all {seen.rows:,} events lie within {span_us / 1e3:g} ms"
    else:
        return
    report.notes.append(f"{where}: if its times are {UNIT_NAMES[unit]}, as it states, {text}; see --time-unit.")


def _us_is_likelier(seen: TableSummary) -> bool:
    """Whether whole numbers that could be milliseconds since 1970 are finer than milliseconds of a camera are."""
    return seen.whole and seen.span_t > 4 * seen.rows


def _polarity(
    seen: TableSummary, options: ImportOptions, report: DecodeReport, where: str
) -> Mapping[str | float, bool]:
    values = seen.polarities
    if options.polarity is not None:
        found: Mapping[str | float, bool] | None = {_key(word): value for word, value in options.polarity.items()}
        known = sum(count for value, count in values.items() if value in found)
    else:
        found, known = _known_pair(values)
    # Few odd values are damage (SensorsINI/v2e#41); more of them are a code that nobody here knows (1 and 2 in
    # tallamjr/evlib#57, 0 to 3 in better-flow/evimo#20).
    allowed = min(allowed_odd(seen.rows), known // 4)
    if found is None or seen.rows - known > allowed:
        raise _unknown_polarities(values, where)
    kept = {value: on for value, on in found.items() if value in values}
    _report_polarity(kept, seen.rows, report, where, stated=options.polarity is not None)
    return found


def _unknown_polarities(values: Mapping[str | float, int], where: str) -> RecordingError:
    listed = ", ".join(_shown(value) for value in sorted(values, key=str)[:8]) + (", ..." if len(values) > 8 else "")
    return RecordingError(
        "which polarity is ON cannot be told",
        expected="0 and 1, -1 and 1, or true and false",
        got=listed,
        where=where,
        remedy="give --polarity, such as --polarity 1=on,2=off",
    )


def _report_polarity(
    kept: Mapping[str | float, bool], rows: int, report: DecodeReport, where: str, *, stated: bool
) -> None:
    """Note what the values that occur mean, and what was assumed of them."""
    meanings = ", ".join(f"{_shown(value)} = {'ON' if on else 'OFF'}" for value, on in sorted(kept.items(), key=str))
    certain = all(isinstance(value, str) or value <= 1 for value in kept)
    origin = FactOrigin.OPTION if stated else FactOrigin.FILE if certain else FactOrigin.ASSUMED
    report.facts[POLARITY] = Fact(meanings or "no events", origin)
    if stated:
        return
    large = [on for value, on in kept.items() if isinstance(value, float) and value > 1]
    if large:
        why = "" if all(large) else " (-1 in a column without a sign)"
        report.assume(f"{where}: the polarities are read as {meanings}{why}.")
    elif len(kept) == 1 and rows > FEW_ODD:
        report.notes.append(f"{where}: all polarities are alike: {meanings}.")


def _known_pair(values: Mapping[str | float, int]) -> tuple[Mapping[str | float, bool] | None, int]:
    """The pair of values that covers most rows, and how many it covers."""
    pairs: list[Mapping[str | float, bool]] = [*_NUMBERS, _WORDS]  # pyright: ignore[reportAssignmentType]
    covered = [sum(count for value, count in values.items() if value in pair) for pair in pairs]
    best = int(np.argmax(covered))
    used = [value for value in values if value in pairs[best]]
    if len(used) == 1 and isinstance(used[0], float) and used[0] > 1:  # all 255: ON or OFF?
        return None, 0
    return (pairs[best], covered[best]) if covered[best] or not values else (None, 0)


def _polarity_column(p: NDArray, on: Mapping[str | float, bool]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which rows are ON, and which have one of the known values."""
    if p.dtype.kind == "b":
        return p, np.ones(len(p), np.bool_)
    if p.dtype.kind in "SUO":
        text = p.astype(object) if p.dtype.kind == "O" else p
        words = [word.decode("latin-1") if isinstance(word, bytes) else word for word in text.tolist()]
        values, places = np.unique(np.array(words, str), return_inverse=True)
        table = np.array([on.get(_key(str(value))) for value in values], object)
        known = np.array([item is not None for item in table], np.bool_)
        return np.array([bool(item) for item in table], np.bool_)[places], known[places]
    is_on, known = np.zeros(len(p), np.bool_), np.zeros(len(p), np.bool_)
    as_float = p.astype(np.float64)
    for value, positive in on.items():
        if isinstance(value, float | int):
            here = as_float == value
            known |= here
            if positive:
                is_on |= here
    return is_on, known


def _key(word: str) -> str | float:
    """A polarity that is written as text: a number if it is one."""
    try:
        return float(word)
    except ValueError:
        return word.strip().strip("\"'").lower()


def _shown(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:.20g}"
