"""Damaged files: whatever happens to an exported file, an import neither crashes nor drops a label silently."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.events import SensorSize
from labels.formats import ExportOptions, ImportContext, LabelFormat, LabelSet
from labels.model import Label, LabelState

SENSOR = SensorSize(1280, 720)
TRIAL_LABELS = 12
_NUMBERS = re.compile(rb"-?\d+(\.\d+)?")
_RUBBISH = (
    b"nan",
    b"inf",
    b"-1e999",
    b"1e999",
    b"",
    b"ball",
    b"0x10",
    b"9" * 400,
    b"None",
    b"\xff\xfe",
    b"1,5",
    b"1 2",
)


@dataclass(frozen=True, slots=True)
class DamageResult:
    """What came of so many damaged sets of files."""

    trials: int
    crashes: int
    silent_drops: int
    nameless: int
    """Rejections without a file or a line."""
    rejected: int
    """Sets with at least one rejection."""
    first_problem: str


def trial_set(rng: np.random.Generator, count: int = TRIAL_LABELS) -> LabelSet:
    """Visible balls away from the edges, and now and then none."""
    labels = []
    for index in range(count):
        if index % 6 == 5:
            labels.append(Label(t_us=index * 2000, state=LabelState.NO_BALL))
            continue
        x, y, r = rng.uniform(40, 1240), rng.uniform(40, 680), rng.uniform(2, 15)
        labels.append(Label(t_us=index * 2000, state=LabelState.VISIBLE, x_px=float(x), y_px=float(y), r_px=float(r)))
    return LabelSet("trial", "left", "anna", SENSOR, tuple(labels))


def damage_and_read(kind: LabelFormat, trials: int, rng: np.random.Generator, folder: Path) -> DamageResult:
    """Export, damage one file, import; again and again.

    A drop is silent when fewer labels come back than were written and nothing is rejected. (No act here takes whole
    rows out of a table: what is left would be a whole, smaller table.)
    """
    crashes = drops = nameless = rejected = 0
    problem = ""
    context = ImportContext(SENSOR, np.arange(0, 10**6, 2000))
    for _ in range(trials):
        shutil.rmtree(folder, ignore_errors=True)
        target = folder / "labels.h5" if kind.name == "hdf5" else folder
        labels = trial_set(rng)
        files = kind.write(labels, target, ExportOptions()).files
        victim = files[int(rng.integers(len(files)))]
        name, act = ACTS[int(rng.integers(len(ACTS)))]
        before = victim.read_bytes()
        after = act(before, rng)
        victim.write_bytes(after)
        what = f"{kind.name}: {name} in {victim.name}"
        try:
            imported = kind.read(target, context)
        except Exception as error:
            crashes += 1
            problem = problem or f"{what}: {error!r}"
            continue
        nameless += sum(not str(item.file) or item.line < 1 for item in imported.rejections)
        rejected += bool(imported.rejections)
        if len(imported.labels) < len(labels.labels) and not imported.rejections:
            drops += 1
            problem = problem or f"{what}: {len(imported.labels)} labels"
    return DamageResult(trials, crashes, drops, nameless, rejected, problem)


def _flip(content: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(content)
    for _ in range(int(rng.integers(1, 4))):
        if changed:
            changed[int(rng.integers(len(changed)))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _number(content: bytes, rng: np.random.Generator) -> bytes:
    found = list(_NUMBERS.finditer(content))
    if not found:
        return content
    at = found[int(rng.integers(len(found)))]
    return content[: at.start()] + _RUBBISH[int(rng.integers(len(_RUBBISH)))] + content[at.end() :]


def _cut_inside(content: bytes, rng: np.random.Generator) -> bytes:
    """Cut off in the last line, in its first half: no format takes half a line for a whole one."""
    body = content.rstrip(b"\n")
    start = body.rfind(b"\n") + 1
    return content[: start + max(1, (len(body) - start) // 4)]


def _take_out(content: bytes, rng: np.random.Generator) -> bytes:
    """A few bytes less, within one line."""
    lines = content.split(b"\n")
    row = int(rng.integers(len(lines)))
    line = lines[row]
    if len(line) > 2:
        start = int(rng.integers(1, len(line) - 1))
        lines[row] = line[:start] + line[min(start + int(rng.integers(1, 6)), len(line) - 1) :]
    return b"\n".join(lines)


def _insert(content: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(len(content) + 1))
    return content[:at] + rng.integers(0, 256, int(rng.integers(1, 20)), np.uint8).tobytes() + content[at:]


def _twice(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.splitlines(keepends=True)
    row = int(rng.integers(len(lines))) if lines else 0
    return b"".join([*lines[: row + 1], *lines[row : row + 1], *lines[row + 1 :]])


ACTS: tuple[tuple[str, Callable[[bytes, np.random.Generator], bytes]], ...] = (
    ("flipped bits", _flip),
    ("another number", _number),
    ("cut inside a line", _cut_inside),
    ("bytes taken out", _take_out),
    ("bytes inserted", _insert),
    ("a line twice", _twice),
    ("byte order mark", lambda content, _: b"\xef\xbb\xbf" + content),
    ("Windows lines", lambda content, _: content.replace(b"\n", b"\r\n")),
    ("another class", lambda content, _: content.replace(b"ball", b"bat")),
    ("emptied", lambda content, _: b""),
    ("zeros", lambda content, _: b"\0" * len(content)),
)
