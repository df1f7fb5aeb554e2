"""What an import took and what it rejected, by reason and with examples."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Final

from labels.formats.exchange import Imported
from labels.model import Label

EXAMPLES: Final = 3


@dataclass(frozen=True, slots=True)
class RejectedFor:
    """Rejections of one kind."""

    reason: str
    count: int
    examples: tuple[str, ...]
    """Up to three, with their places."""


@dataclass(frozen=True, slots=True)
class ImportReport:
    """The table at the end of an import."""

    files: int
    taken: int
    rejected: tuple[RejectedFor, ...]
    """The most frequent first."""
    examples: tuple[Label, ...]
    """Up to three labels that were taken, with a ball if there are any, spread over the import."""
    notes: tuple[str, ...]
    """What the files do not say themselves and where it was found."""
    states: dict[str, int]
    """State of a label -> how many were taken."""
    first_us: int | None
    """Time of the first label that was taken, as `last_us` that of the last; None if none was."""
    last_us: int | None
    contacts: int = 0
    """Bounces, hits and net touches that were taken."""

    @property
    def rows(self) -> tuple[tuple[str, str], ...]:
        """What, and how many."""
        reasons = ((f"rejected: {item.reason}", f"{item.count}") for item in self.rejected)
        contacts = (("contacts", f"{self.contacts}"),) if self.contacts else ()
        return (("files", f"{self.files}"), ("taken", f"{self.taken}"), *contacts, *reasons)


def report_of(imported: Imported) -> ImportReport:
    """Count what came of the entries of the files."""
    kinds: dict[str, list[str]] = {}
    for rejection in imported.rejections:
        kinds.setdefault(rejection.kind, []).append(str(rejection))
    rejected = tuple(
        RejectedFor(reason, len(found), tuple(found[:EXAMPLES]))
        for reason, found in sorted(kinds.items(), key=lambda item: -len(item[1]))
    )
    seen = [label for label in imported.labels if label.x_px is not None] or list(imported.labels)
    spread = {0, len(seen) // 2, len(seen) - 1} if seen else set()
    examples = tuple(seen[index] for index in sorted(spread))
    times = [label.t_us for label in imported.labels]
    states = dict(sorted(Counter(str(label.state) for label in imported.labels).items()))
    return ImportReport(
        imported.files, len(times), rejected, examples, imported.notes,
        states, min(times, default=None), max(times, default=None), len(imported.contacts),
    )  # fmt: skip


def describe_label(label: Label) -> str:
    """A label in a line."""
    place = "" if label.x_px is None else f" at ({label.x_px:.1f}, {label.y_px:.1f})"
    radius = "" if label.r_px is None else f", r {label.r_px:.1f} px"
    return f"{label.t_us} us: {label.state}{place}{radius}"
