"""Figures and pictures of the page about real recordings, from public files.

    python -m docs.real_recordings --planet gen4.dat --dot rotating_dot_evt2_640x480.raw --walker data_sample.aedat4

Every method runs with its default settings over each whole file that is given. The tables replace those in
`docs/use/real-recordings.md`, the pictures those in `docs/images/real-recordings/`.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from app.pictures.canvas import Canvas, Region
from app.pictures.palette import palette
from app.views.stage_picture import draw_stage
from core.config import load_config
from core.detection import DetectorConfig
from core.detection.methods import METHODS, make_detector, method_config
from core.detection.reasons import FIXED, ReasonCount, ReasonCounter
from core.errors import CommandError
from core.metrics.run import explain_window, run_detector
from core.recordings import CameraStream, open_recording

PAGE: Final = Path("docs/use/real-recordings.md")
PICTURES: Final = Path("docs/images/real-recordings")
EXAMPLE_CONFIGS: Final = Path("docs/examples")
PANEL_PX: Final = 420
"""Width and height of a panel of a picture."""
BAND_PX: Final = 22
"""Height of the title above a panel."""
COLOURS: Final = 64
REASONS: Final = 3
"""Reasons listed of a method."""


@dataclass(frozen=True, slots=True)
class Panel:
    """A view of a method's trace."""

    method: str
    view: str


@dataclass(frozen=True, slots=True)
class Example:
    """What is shown of a recording."""

    t_us: int
    """End of the windows of its picture."""
    centre_px: tuple[int, int]
    side_px: int
    """The square of the sensor that is shown."""
    panels: tuple[Panel, ...]
    configs: tuple[tuple[str, str, Path], ...] = ()
    """Further rows of the table: their title, the method and its settings, if that file exists."""


EXAMPLES: Final = {
    "planet": Example(
        900_000, (480, 300), 210,
        (Panel("refined", "edge points"), Panel("refined", "fit"), Panel("fe-fusion", "clusters")),
        (("`refined`, [planet](../examples/planet.toml)", "refined", EXAMPLE_CONFIGS / "planet.toml"),),
    ),
    "dot": Example(
        25_000, (385, 285), 140,
        (Panel("refined", "edge points"), Panel("refined", "track"), Panel("auto", "geometry")),
        (("`auto`, [rotating-dot](../examples/rotating-dot.toml)", "auto", EXAMPLE_CONFIGS / "rotating-dot.toml"),),
    ),
    "walker": Example(
        1_068_000, (155, 125), 210,
        (Panel("refined", "candidates"), Panel("refined", "fit"), Panel("auto", "clusters")),
    ),
}  # fmt: skip


def main() -> None:
    """Write the tables and the pictures of the files that are given."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in EXAMPLES:
        parser.add_argument(f"--{name}", type=Path, metavar="FILE")
    given = vars(parser.parse_args())
    page = PAGE.read_text()
    for name, example in EXAMPLES.items():
        if given[name] is None:
            continue
        with open_recording(given[name]) as recording:
            stream = next(iter(recording.cameras.values()))
            page = with_table(page, name, table_of(stream, example))
            save_picture(picture_of(stream, example), PICTURES / f"{name}.png")
    PAGE.write_text(page)


def with_table(page: str, name: str, table: str) -> str:
    """The page with the lines between the marks of a recording replaced.

    Raises:
        CommandError: if the page has no such marks.
    """
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    changed, count = re.subn(f"{begin}.*?{end}", lambda _: f"{begin}\n{table}\n{end}", page, flags=re.DOTALL)
    if count != 1:
        raise CommandError("the page has no place for a table", expected=f"one {begin} ... {end}", where=str(PAGE))
    return changed


def table_of(stream: CameraStream, example: Example) -> str:
    """Markdown table of all methods: windows, share with a ball, the most frequent reasons of the others."""
    rows = [
        "| method | windows | with a ball | radius, px | most frequent reasons, share of the others, setting |",
        "|---|---|---|---|---|",
    ]
    for title, method, config in _runs(example):
        counter = ReasonCounter()
        settings = method_config(method, config)
        detector = make_detector(method, stream.sensor, settings)
        answers = run_detector(stream, detector, settings.window.window_us, reasons=counter)
        found, windows = int(answers.detected.sum()), len(answers.end_us)
        radius = f"{np.nanmedian(answers.r_px):.1f}" if found else "-"
        why = "<br>".join(reason_cell(one, windows - found) for one in counter.counts()[:REASONS]) or "-"
        rows.append(f"| {title} | {windows:,} | {found:,} ({100 * found / windows:.1f} %) | {radius} | {why} |")
    return "\n".join(rows)


def reason_cell(reason: ReasonCount, windows: int) -> str:
    """A reason for a table: its numbers, the share of the windows, its setting."""
    setting = FIXED if reason.setting is None else f"`{reason.setting}`"
    text = reason.text.replace("<", "&lt;").replace(">", "&gt;")
    return f"{text}, {100 * reason.windows / windows:.0f} %, {setting}"


def _runs(example: Example) -> Iterator[tuple[str, str, DetectorConfig | None]]:
    for method in METHODS:
        yield f"`{method}`", method, None
    for title, method, path in example.configs:
        if path.exists():
            yield title, method, load_config(DetectorConfig, path)


def picture_of(stream: CameraStream, example: Example) -> NDArray[np.uint8]:
    """(height, width, 3) the panels beside each other, each under its title."""
    u, v = example.centre_px
    region = Region(u - example.side_px // 2, v - example.side_px // 2, example.side_px, example.side_px)
    panels = []
    for panel in example.panels:
        answer = explain_window(stream, panel.method, method_config(panel.method), example.t_us)
        assert answer.trace is not None
        canvas = Canvas(region, width_px=PANEL_PX)
        draw_stage(canvas, answer.window, answer.trace, panel.view, "polarity")
        image = palette("orange / blue")[canvas.image].astype(np.uint8)
        image = np.asarray(Image.fromarray(image).resize((PANEL_PX, PANEL_PX), Image.Resampling.LANCZOS))
        image = cv2.copyMakeBorder(image, BAND_PX, 0, 0, 6, cv2.BORDER_CONSTANT, value=(20, 20, 24))
        title = f"{panel.method}: {panel.view}"
        cv2.putText(image, title, (4, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (235, 235, 235), 1, cv2.LINE_AA)
        panels.append(image)
    return np.concatenate(panels, axis=1)


def save_picture(picture: NDArray[np.uint8], path: Path) -> None:
    """Write it with few colours, and say how large it became."""
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(picture).quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
