"""Formatting of values, names and errors (units, sizes, shares, escaped HTML, notifications), the facts of an event
file as rows of a table, and the app's words in a sentence each, for tooltips; docs/use/glossary.md has the same
words.
"""

from __future__ import annotations

import html
import itertools
import math
import re
from collections.abc import Iterable, Mapping
from typing import Final

from core.errors import RallyscopeError
from core.recordings.import_facts import IMPORTED_FROM, ImportFacts, SourceFacts
from core.recordings.sources.source import FactOrigin
from core.text import LONGEST, counted, plain

UNITS = {"us": "µs", "ms": "ms", "px": "px", "hz": "Hz", "s": "s", "rad": "rad", "mps": "m/s", "m": "m", "deg": "°"}
FIELD_OF_A_CLASS: Final = re.compile(r"^[A-Z]\w*Config\.(\w+)")
SEVERAL_WORDS: Final = re.compile(r"\b[a-z0-9]+(?:_[a-z0-9]+)+\b")


PLAIN_NAMES: Final = {
    "stray_max": "outlier share, max (stray max)",
    "fill_min": "filled share, min (fill min)",
    "stretch_min_ms": "edge latency, min [ms] (stretch min)",
    "stretch_max_ms": "edge latency, max [ms] (stretch max)",
    "evidence_min": "evidence to confirm (evidence min)",
    "pace_min_per_ms": "slowest ball [radii/ms] (pace min)",
    "coast_us": "prediction while unseen [µs] (coast)",
    "inside_max": "events inside, max (inside max)",
    "both_edges_min": "coverage of the weaker edge (both edges min)",
    "all_round_min": "one polarity all round (all round min)",
    "steady_radius": "spread of the radii, max (steady radius)",
    "same_radius": "change of the radius, max (same radius)",
    "given_up": "evidence to give up (given up)",
    "confirmed_given_up": "evidence to give up a ball (confirmed given up)",
}
"""Names of fields whose own name does not say what is measured; it stands behind, as in files and documentation. They
have the words of the reasons that lead to their sliders."""


def field_words(field: str) -> str:
    """The unit in its suffix is set apart: `eps_px` -> "eps [px]"."""
    if field in PLAIN_NAMES:
        return PLAIN_NAMES[field]
    for above, below in itertools.product(UNITS, UNITS):
        if field.endswith(f"_{above}_per_{below}"):
            return f"{field.removesuffix(f'_{above}_per_{below}').replace('_', ' ')} [{UNITS[above]}/{UNITS[below]}]"
    name, _, suffix = field.rpartition("_")
    if name and suffix in UNITS:
        return f"{name.replace('_', ' ')} [{UNITS[suffix]}]"
    return field.replace("_", " ")


def in_control_words(details: str) -> str:
    """What is said of a field of a config, `LocaliseConfig.radius_max_px; expected ...`, in the words of its control.

    Anything else stays as it is: what has underscores there may be the name of a file.
    """
    of_class = FIELD_OF_A_CLASS.match(details)
    if of_class is None:
        return details
    rest = SEVERAL_WORDS.sub(lambda found: field_words(found[0]), details[of_class.end() :])
    return f'"{field_words(of_class[1])}"{rest}'


def size_text(size_bytes: int) -> str:
    """Readable text of a number of bytes, in the largest unit that it fills, with two digits or more."""
    for unit, bytes_ in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size_bytes >= bytes_:
            return f"{size_bytes / bytes_:.{0 if size_bytes >= 10 * bytes_ else 1}f} {unit}"
    return counted(size_bytes, "byte")


def html_text(text: str, most: int = LONGEST) -> str:
    """One line of it, for an element or a quoted attribute; at most `most` characters are shown."""
    return html.escape(plain(text, most), quote=True)


LONGEST_TITLE: Final = 80


def note_html(text: str, colour: str) -> str:
    """A line of HTML in small letters, below a control."""
    return f"<div style='font-size:12.5px;padding:1px 12px;color:{colour}'>{text}</div>"


def table_row(cells: Iterable[object], style: str = "", *, tag: str = "td", row_style: str = "") -> str:
    """A row of a table of HTML; `style` is that of every cell."""
    return _opened("tr", row_style) + "".join(f"{_opened(tag, style)}{cell}</{tag}>" for cell in cells) + "</tr>"


def _opened(tag: str, style: str) -> str:
    return f"<{tag} style='{style}'>" if style else f"<{tag}>"


def notice_of(error: RallyscopeError) -> tuple[str, str]:
    """Title and text of a notification."""
    what = error.what[:1].upper() + error.what[1:]
    if len(what) > LONGEST_TITLE:
        cut = what[:LONGEST_TITLE].rpartition(" ")[0] or what[:LONGEST_TITLE]
        return f"{cut} ...", str(error)
    return what, in_control_words(error.details)


def percent(share: float) -> str:
    """A share 0 to 1 as a whole per cent; 259 of 260 is 99 %, as 100 % says that none is left out."""
    value = 100.0 * share
    if 0.0 < value < 1.0:
        return "1 %"
    return f"{math.floor(value + 1e-9) if value > 99.0 else round(value)} %"


def share_text(share: float, digits: int = 3) -> str:
    """A share 0 to 1 with decimals, "-" for nan; only 1 itself reads 1.000, and only 0 reads 0.000.

    2183 of 2184 is 0.999: rounded to 1.000 it would stand beside "missed 1".
    """
    if not math.isfinite(share):
        return "-"
    least = 10.0**-digits
    return f"{min(max(share, least), 1.0 - least) if 0.0 < share < 1.0 else share:.{digits}f}"


DASH_CELL: Final = re.compile(r"(>|/ )-(<| /)")
"""A cell without a figure, or without one of two."""
NOTHING_MEASURED: Final = "no ball was found or asked for"


def with_dashes_explained(table: str, why: str = NOTHING_MEASURED) -> str:
    """HTML of a table, and below it what its dashes stand for, where it has any."""
    return f"{table}<div>-: {why}</div>" if DASH_CELL.search(table) else table


PAGE: Final = "docs/use/glossary.md"

GLOSSARY: Final[dict[str, str]] = {
    "Auto-serve": "The simulation serves repeatedly at the chosen speed.",
    "Bias": "An analogue setting of all pixels of an event camera, such as how much contrast makes an event.",
    "Block": "10 ms of the simulation: it is computed, published and processed as a unit.",
    "Calibration": "Lens and pose of each camera. Drift: ball to the other's epipolar line, alarm above 0.42 px.",
    "CDTA": "Case-dependent temporally adaptive reward: first it pays for returning the ball, later for placing it.",
    "Circularity": "4 pi area / perimeter^2 of a cluster's hull: 1 for a disc, 0.79 for a square.",
    "Cluster": "Events that lie close together (DBSCAN): the ball is one of them, a racket or a person are others.",
    "Epipolar line": "Where the other camera's ball must lie in this picture.",
    "Event": "What a pixel of an event camera reports: it became brighter (ON) or darker (OFF), and when.",
    "Event camera": "A camera that takes no pictures: each pixel reports changes of light by itself, as they happen.",
    "Hit chosen": "Where on its flight the ball is to be hit, the chance to return it, how many places were possible.",
    "Hit predicted after the bounce": "Where the ball is to be hit, predicted after the bounce.",
    "Hit predicted before the bounce": "Where the ball is to be hit, predicted before the bounce; starts the racket.",
    "Hitting plane": "x = -1.42 m, 5 cm behind the table: the paper's place of the hit (serve --hit paper).",
    "Latency": "Time from an event to the reaction to it.",
    "Leading polarity": "Whether the ball's front edge makes the ON or the OFF events.",
    "Pace": "Simulated seconds per second: below real time is slow motion.",
    "Precision": "The share of a detector's answers that are a ball.",
    "Recall": "The share of the balls that were found.",
    "ROI": "Region of interest: the part of the sensor, round the last ball, that is searched.",
    "Seen to racket": "Time from the end of the window with the ball to the racket command being sent.",
    "Sensor readout": "Transfer of events out of a camera: above its capacity they come late, or never.",
    "Sigma": "Standard deviation: two of three errors are smaller.",
    "Skipped blocks": "Blocks that arrived too late to be processed, because the machine was busy.",
    "Snap": "A click moves to the circle that fits the events.",
    "Solidity": "Pixels with events per area of a cluster's hull.",
    "Stereo": "Two cameras that see the same ball: its position is where their lines of sight meet.",
    "Stereo mismatch": "How far the cameras' circles are from one ball in space, in pixels: below 1 is good.",
    "Tube": "Round a predicted flight: two standard deviations to each side.",
    "Window": "The time interval whose events are processed together.",
}
"""Explanation by word, in alphabetical order."""


def tooltip(word: str) -> str:
    """Tooltip with the explanation, and where to find the glossary."""
    return f"{word}: {GLOSSARY[word]} ({PAGE})"


Row = tuple[str, str]
_WHENCE: Final[Mapping[str, str]] = {
    FactOrigin.FORMAT: "as the format defines",
    FactOrigin.FILE: "from the file",
    FactOrigin.OPTION: "as given",
    FactOrigin.CALIBRATION: "from the calibration beside it",
    FactOrigin.CAMERA: "of the camera that the file names",
    FactOrigin.DATA_SET: "assumed, of this data set",
    FactOrigin.ASSUMED: "assumed",
}


def fact_rows(camera: SourceFacts, *, complete: bool = True) -> list[Row]:
    """What each fact is called, and its value with where it is from."""
    event_count = f"{camera.events:,}" + ("" if complete else " in the part that was looked at")
    extras = [
        counted(count, what) for count, what in ((camera.triggers, "trigger edge"), (camera.pictures, "picture"))
        if count
    ]  # fmt: skip
    lasted = "none"
    if camera.first_us is not None and camera.last_us is not None:
        lasted = f"{camera.first_us:,} us to {camera.last_us:,} us on its own clock"
    calibration = "none" if camera.calibration_from is None else _whence(camera.calibration_from)
    return [
        ("format", camera.format),
        ("sensor", f"{camera.width_px}x{camera.height_px}, {_whence(camera.sensor_from)}"),
        ("time unit", f"{camera.time_unit}, {_whence(camera.time_unit_from)}"),
        ("polarity", f"{camera.polarity}, {_whence(camera.polarity_from)}"),
        ("events", ", ".join([f"{event_count}: {camera.on_events:,} ON, {camera.off_events:,} OFF", *extras])),
        ("first, last", lasted),
        ("calibration", calibration),
        ("left out", _counted(camera.left_out) if complete else "known after the import"),
        ("corrected", _counted(camera.changed) if complete else "known after the import"),
    ]


def check_lines(facts: ImportFacts) -> list[str]:
    """What `import --check` prints: each camera, what is assumed, and the other notes."""
    lines: list[str] = []
    for camera in facts.cameras:
        lines.append(f"{camera.file}, camera {camera.name}")
        lines += [f"  {label:<12} {value}" for label, value in fact_rows(camera, complete=facts.complete)]
    lines.append(f"duration     {facts.duration_us / 1e6:.6f} s")
    lines += [f"assumed:     {line}" for line in facts.assumed] or ["assumed:     nothing"]
    others = [note for note in facts.notes if note not in facts.assumed and not note.startswith(IMPORTED_FROM)]
    return lines + [f"note:        {note}" for note in others]


def _whence(word: str) -> str:
    return _WHENCE.get(word, word)


def _counted(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count:,} {what}" for what, count in counts.items()) or "nothing"
