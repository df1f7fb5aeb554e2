"""The text in front of a Prophesee RAW or DAT file: lines that begin with a percent sign."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.events import SensorSize
from core.recordings.sources.source import DecodeReport
from core.recordings.sources.values.stated_sizes import size_in_text, size_of

_MAX_HEADER: Final = 64 << 10
_GENERATIONS: Final = (
    (("gen31", "gen3.1", "gen3_", "gen3"), SensorSize(640, 480)),
    (("gen4", "imx636", "imx646", "gen41"), SensorSize(1280, 720)),
    (("genx320",), SensorSize(320, 320)),
)
"""Old headers name only the plug-in of the camera; its generation tells the sensor."""
_FIRST_UNSWAPPED: Final = 0x37
"""system_ID of the first of Prophesee's own cameras (the EVK2 with Saphir) whose words of EVT2.1 are whole."""
_END: Final = re.compile(rb"((?:%[^\n]*\n)*?)%\s*end\r?\n")
"""A whole header with the line that ends it."""


@dataclass(frozen=True, slots=True)
class PropheseeHeader:
    """What the header says; None where it says nothing."""

    size_bytes: int
    version: str | None
    """Format of a RAW file: "EVT2", "EVT2.1" or "EVT3", or another name the header gives."""
    sensor: SensorSize | None
    word_swapped: bool
    """EVT2.1 as the first cameras wrote it: the two halves of each word exchanged."""
    is_dat: bool
    dat_version: int | None
    """Version of a DAT file."""
    sensor_by_camera: bool = False
    """Whether the size is not stated, but that of the camera that the header names."""
    other_sensor: SensorSize | None = None
    """Another size that the header states, too."""


def read_prophesee_header(path: Path) -> PropheseeHeader:
    """Parse the header; a file without one has size 0 and knows nothing."""
    with path.open("rb") as file:
        head = file.read(_MAX_HEADER)
    lines, size = _header_lines(head)
    fields: dict[str, str] = {}
    for line in lines:
        key, _, value = line.partition(" ")
        fields.setdefault(key.lower().rstrip(":"), value.strip())
    format_name, _, extras = fields.get("format", "").partition(";")
    options = dict(item.strip().split("=", 1) for item in extras.split(";") if "=" in item)
    stated = _stated_sensors(lines, options)
    version = _version(fields.get("evt"), format_name)
    return PropheseeHeader(
        size,
        version,
        stated[0] if stated else _sensor_of_camera(fields),
        version == "EVT2.1" and _is_word_swapped(fields, options),
        is_dat=_is_dat(lines, head[size : size + 2]),
        sensor_by_camera=not stated,
        dat_version=int(fields["version"]) if fields.get("version", "").isdigit() else None,
        other_sensor=stated[1] if len(stated) > 1 else None,
    )


def note_two_sizes(header: PropheseeHeader, name: str, report: DecodeReport) -> None:
    """Say which size is taken where the header states two."""
    if header.other_sensor is not None:
        report.assume(f"{name} states two sensor sizes, {header.sensor} and {header.other_sensor}; the first is taken.")


def text_follows(path: Path, header: PropheseeHeader) -> bool:
    """Whether what follows the header is text: a camera's stream has bytes above 127 all along."""
    with path.open("rb") as file:
        file.seek(header.size_bytes)
        head = file.read(4096)
    return len(head) >= 16 and all(32 <= byte < 127 or byte in b"\t\r\n" for byte in head)


def _header_lines(head: bytes) -> tuple[list[str], int]:
    lines: list[str] = []
    size = 0
    ended = _END.match(head)
    if ended is not None:  # up to its own end all is header, whatever letters it has
        return [_decoded(line) for line in ended.group(1).splitlines()], ended.end()
    while head[size : size + 1] == b"%":
        end = head.find(b"\n", size)
        line = head[size:end]
        if end < 0 or not all(32 <= byte < 127 or byte in b"\t\r" for byte in line):
            break  # the first word of the events happens to begin like a header line
        size = end + 1
        text = line[1:].decode("ascii").strip()
        if text == "end":
            break
        lines.append(text)
    return lines, size


def _decoded(line: bytes) -> str:
    """A line of the header without its percent sign."""
    try:
        return line[1:].decode("utf-8").strip()
    except UnicodeDecodeError:
        return line[1:].decode("latin-1").strip()


def _version(evt: str | None, format_name: str) -> str | None:
    if format_name:
        name = format_name.upper()
        return {"EVT21": "EVT2.1"}.get(name, name)
    if evt is not None:
        return {"2.0": "EVT2", "2": "EVT2", "2.1": "EVT2.1", "3.0": "EVT3", "3": "EVT3"}.get(evt, f"EVT{evt}")
    return None


def _is_word_swapped(fields: dict[str, str], options: dict[str, str]) -> bool:
    """As OpenEB decides for EVT2.1: by what the header states, or else by the age of Prophesee's own camera."""
    if stated := options.get("endianness") or fields.get("endianness"):
        return stated == "legacy"
    keys = "plugin_integrator_name", "camera_integrator_name"
    makers = {fields.get(key) or fields.get("integrator_name") for key in keys}
    system = fields.get("system_id", "")
    return makers == {"Prophesee"} and system.isdecimal() and 0 < int(system) < _FIRST_UNSWAPPED


def _stated_sensors(lines: list[str], options: dict[str, str]) -> list[SensorSize]:
    """The different sizes that the header states, those of the format first."""
    found = [size_of(options.get("width"), options.get("height"))]
    found += [size_in_text([line]) for line in lines if not line.lower().startswith("format")]
    found.append(size_in_text(line for line in lines if line.lower().startswith(("width", "height"))))
    return list(dict.fromkeys(size for size in found if size is not None))


def _sensor_of_camera(fields: dict[str, str]) -> SensorSize | None:
    plugin = " ".join(fields.get(key, "").lower() for key in ("plugin_name", "camera_integrator_name", "sensor_name"))
    for names, sensor in reversed(_GENERATIONS):
        if any(name in plugin for name in names):
            return sensor
    return None


def _is_dat(lines: list[str], following: bytes) -> bool:
    """DAT files say so in words, or by the type and size of their events, which follow the header."""
    if any(re.match(r"data file containing", line, re.IGNORECASE) for line in lines):
        return True
    names = {line.split(" ", 1)[0].lower() for line in lines}
    return not names & {"evt", "format", "plugin_name"} and following in (b"\x00\x08", b"\x0c\x08", b"\x0e\x08")
