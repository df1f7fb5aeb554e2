"""What is known of event files before, and after, they become a recording: for `import --check` and the app."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from core.recordings.sources.source import (
    MICROSECONDS,
    POLARITY,
    POLARITY_BIT,
    TIME_UNIT,
    DecodeReport,
    EventSource,
    FactOrigin,
)
from core.text import encodable

IMPORTED_FROM: Final = "Imported from "
"""How the note begins that only names the files."""


@dataclass(frozen=True, slots=True)
class EventCounts:
    """What was counted while the events of one camera were read; times on the file's own clock."""

    events: int = 0
    on: int = 0
    first_us: int | None = None
    """None without events."""
    last_us: int | None = None
    triggers: int = 0
    pictures: int = 0


@dataclass(frozen=True, slots=True)
class SourceFacts:
    """One camera of an event file. What each fact is from is a `FactOrigin`, as text."""

    name: str
    file: str
    """Its name, without folders."""
    format: str
    width_px: int
    height_px: int
    sensor_from: str
    time_unit: str
    time_unit_from: str
    polarity: str
    """Values that were found and what they mean, such as `0 = OFF, 1 = ON`."""
    polarity_from: str
    events: int
    on_events: int
    off_events: int
    first_us: int | None
    """On the file's own clock, as `last_us`; None without events."""
    last_us: int | None
    triggers: int
    pictures: int
    calibration_from: str | None
    """`file` or `option`; None without a calibration."""
    left_out: dict[str, int]
    """Reason -> how many events, words or rows."""
    changed: dict[str, int]
    """What is put right -> how often."""
    assumed: list[str]


@dataclass(frozen=True, slots=True)
class ImportFacts:
    """What an import finds: the same before it writes and after it."""

    cameras: tuple[SourceFacts, ...]
    duration_us: int
    complete: bool
    """Whether all events were looked at; else counts, times and what is left out are those of the first part."""
    notes: tuple[str, ...]
    """As the recording keeps them."""

    @property
    def assumed(self) -> tuple[str, ...]:
        """All that the files do not say themselves."""
        return tuple(dict.fromkeys(line for camera in self.cameras for line in camera.assumed))

    @property
    def needs_a_look(self) -> bool:
        """Whether there is anything that a person may want to know before the recording is written."""
        plain = [note for note in self.notes if not note.startswith(IMPORTED_FROM)]
        return bool(plain or any(camera.left_out or camera.changed or camera.assumed for camera in self.cameras))


def source_facts(
    source: EventSource,
    report: DecodeReport,
    counts: EventCounts,
    *,
    name: str,
    file: str,
    calibration_from: FactOrigin | None,
) -> SourceFacts:
    """The facts of one camera, from what its source stated and what was found on reading it."""
    found = {TIME_UNIT: MICROSECONDS, POLARITY: POLARITY_BIT, **source.facts, **report.facts}
    time_unit, polarity = found[TIME_UNIT], found[POLARITY]
    return SourceFacts(
        name=name,
        file=encodable(file),
        format=source.format,
        width_px=source.sensor.width_px,
        height_px=source.sensor.height_px,
        sensor_from=str(source.sensor_from),
        time_unit=time_unit.value,
        time_unit_from=str(time_unit.origin),
        polarity=polarity.value if counts.events else "no events",
        polarity_from=str(polarity.origin),
        events=counts.events,
        on_events=counts.on,
        off_events=counts.events - counts.on,
        first_us=counts.first_us,
        last_us=counts.last_us,
        triggers=counts.triggers,
        pictures=counts.pictures,
        calibration_from=None if calibration_from is None else str(calibration_from),
        left_out=dict(report.left_out),
        changed=dict(report.changed),
        assumed=[encodable(line) for line in report.assumed],
    )


def unused_options(source: EventSource, report: DecodeReport) -> Sequence[str]:
    """What was stated of a file that says it itself: one note for each option that had no effect."""
    given_options = {
        "--time-unit": (TIME_UNIT, report.options.time_unit is not None),
        "--polarity": (POLARITY, report.options.polarity is not None),
    }
    facts = {**source.facts, **report.facts}
    return [
        f"{option} was not used: {source.format} defines its {name}."
        for option, (name, given) in given_options.items()
        if given and name in facts and facts[name].origin != FactOrigin.OPTION
    ]
