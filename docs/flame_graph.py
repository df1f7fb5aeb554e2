"""`python -m docs.flame_graph PROFILE... --out FILE.svg`: where the processor's time goes, as a flame graph.

A profile is what `py-spy record --threads --format raw --output PROFILE --pid PID` writes of a process that runs: a
line per stack, frames from the outside in, and how often it was met. Stacks that wait are left out; so are the frames
that every thread begins with. Several profiles stand above each other, each as wide as its own time.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from core.metrics.charts import INK, STYLE

WAITS: Final = (
    "_worker (concurrent",
    "Condition.wait ",
    "Poller.poll ",
    "EpollSelector.select ",
    "watch (core/files",
    "_do_waitpid ",
    "ChildProcess._read ",
    "App._run (app/server",
    "_run (benchmarks/app",
)
"""Innermost frames of a thread that does nothing."""
BEGINNINGS: Final = re.compile(
    r"^(Thread\._bootstrap|Thread\.run|_WorkItem\.run|_worker|_run_code|_run_module|<module>|<lambda>|add_verb"
    r"|main \(|_run \()"
)
COLOURS: Final = {
    "core/simulation": "#d98f4e",
    "core/cameras": "#c9b458",
    "core/chain": "#6f9fd8",
    "core/": "#8fb996",
    "app/": "#b48ac2",
    "numpy": "#b8b8b8",
    "": "#d0d0d0",
}
"""By the begin of a frame's file."""
LEAST: Final = 0.004
"""Of a profile's time: narrower frames are not drawn."""
DEEPEST: Final = 14


@dataclass(slots=True)
class Frame:
    """A function within those that called it."""

    name: str
    file: str
    count: int = 0
    inner: dict[str, Frame] = field(default_factory=dict)


def read_profile(lines: Iterable[str]) -> Frame:
    """The tree of all stacks that did not wait; a function's lines count together."""
    root = Frame("all", "")
    for line in lines:
        stack, _, times = line.rstrip().rpartition(" ")
        frames = [frame.strip() for frame in stack.split(";")]
        if not times.isdigit() or any(wait in frames[-1] for wait in WAITS):
            continue
        root.count += int(times)
        here = root
        for name, file in _named(frames):
            here = here.inner.setdefault(f"{name} {file}", Frame(name, file))
            here.count += int(times)
    return root


def _named(frames: list[str]) -> Iterator[tuple[str, str]]:
    for frame in frames:
        thread = re.match(r"^thread \(\S+\): (.+)$", frame)
        if thread is not None:
            yield re.sub(r"[-_]?\d+$", "", thread[1]), "thread"
        elif not BEGINNINGS.match(frame):
            name, _, place = frame.partition(" (")
            yield name.replace(".<locals>", ""), place.rstrip(")").rpartition(":")[0]


def draw(profiles: dict[str, Frame], out: Path) -> None:
    """Write the picture."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.axes import Axes
    from matplotlib.patches import Rectangle

    def put(axes: Axes, frame: Frame, left: float, depth: int, total: int) -> None:
        width = frame.count / total
        if width < LEAST or depth > DEEPEST:
            return
        colour = next(colour for begin, colour in COLOURS.items() if frame.file.startswith(begin))
        axes.add_patch(Rectangle((left, depth), width, 0.94, facecolor=colour, edgecolor="none"))
        letters = int(width * 175)
        if letters > 3:
            text = frame.name if len(frame.name) <= letters else frame.name[: letters - 1] + "…"
            axes.text(left + 0.002, depth + 0.5, text, va="center", fontsize=6.5, color="#202020", clip_on=True)
        for child in sorted(frame.inner.values(), key=lambda one: -one.count):
            put(axes, child, left, depth + 1, total)
            left += child.count / total

    with mpl.rc_context({**STYLE, "font.size": 8}):
        figure, grid = plt.subplots(len(profiles), 1, figsize=(11, 2.9 * len(profiles)), squeeze=False)
        for axes, (name, root) in zip(grid[:, 0], profiles.items(), strict=True):
            put(axes, root, 0.0, 0, max(root.count, 1))
            axes.set(xlim=(0, 1), ylim=(DEEPEST + 1, 0), xticks=[], yticks=[])
            axes.set_title(f"{name}: {root.count} samples that did not wait", loc="left", color=INK, fontsize=9)
            for side in axes.spines.values():
                side.set_visible(False)
        figure.tight_layout()
        figure.savefig(out, transparent=True, metadata={"Date": None})
        plt.close(figure)


def main(arguments: list[str] | None = None) -> int:
    """Draw."""
    parser = argparse.ArgumentParser(prog="python -m docs.flame_graph", description=__doc__)
    parser.add_argument("profiles", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args(arguments)
    profiles = {path.stem: read_profile(path.read_text("utf-8").splitlines()) for path in asked.profiles}
    draw(profiles, asked.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
