"""Pictures for labelling, each described by a small comparable value, the strip of all times below them, and where they
stand: the small ones below the large one, or beside it in a wide window.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from app.pictures.canvas import TARGET_WIDTH_PX, Canvas, Region, Rendering, encode_png, event_picture
from app.pictures.palette import PaletteIndex, PolarityColours
from app.views.mosaic import SheetText, css_colour
from core.events import Events, SensorSize, Window
from labels.arrays import STATES
from labels.model import LabelState

MAIN_WIDTH_PX: Final = 1280
"""Width of the large picture on the sheet."""
LEAST_WIDTH_PX: Final = 240
"""Width on the sheet below which a ball in a small picture is no longer seen."""
MAX_COLUMNS: Final = 4
GAP_PX: Final = 12
USUAL_ASPECT: Final = 1.4
"""Width over height of the middle of a window of 1280x720."""


@dataclass(frozen=True, slots=True)
class SideLayout:
    """Places of the small pictures, in pixels of the sheet."""

    width_px: int
    """Width of each picture."""
    beside: bool
    """Whether they stand in a column at the right of the large picture; else in rows below it."""
    columns: int
    """Pictures in a row."""


def choose_side_layout(pictures: int, side_ratio: float, base_px: float, aspect: float) -> SideLayout:
    """The layout that leaves the large picture largest in a middle of this width over height.

    The small ones take what the large one cannot use, and no less than `LEAST_WIDTH_PX` each.

    Args:
        pictures: number of small ones.
        side_ratio: height over width of a small one.
        base_px: height of the large one with its line and strip.
        aspect: width over height of the middle.
    """
    rows_below, beside = _below(pictures, side_ratio, base_px, aspect), _beside(pictures, side_ratio, base_px, aspect)
    height_below = base_px + -(-pictures // rows_below.columns) * (rows_below.width_px * side_ratio + GAP_PX)
    scale_below = min(aspect / MAIN_WIDTH_PX, 1 / height_below)
    scale_beside = min(aspect / (MAIN_WIDTH_PX + GAP_PX + beside.width_px), 1 / base_px)
    return beside if scale_beside > scale_below else rows_below


def _below(pictures: int, side_ratio: float, base_px: float, aspect: float) -> SideLayout:
    columns = min(max(pictures, 2), MAX_COLUMNS)
    rows = -(-pictures // columns)
    free_px = MAIN_WIDTH_PX / aspect - base_px - rows * GAP_PX
    widest = (MAIN_WIDTH_PX - (columns - 1) * GAP_PX) // columns
    return SideLayout(round(min(max(free_px / rows / side_ratio, LEAST_WIDTH_PX), widest)), False, columns)


def _beside(pictures: int, side_ratio: float, base_px: float, aspect: float) -> SideLayout:
    widest = ((base_px + GAP_PX) / pictures - GAP_PX) / side_ratio
    free_px = base_px * aspect - MAIN_WIDTH_PX - GAP_PX
    return SideLayout(max(8, round(min(max(free_px, LEAST_WIDTH_PX), widest))), True, 1)


SIGMAS = 2.0
"""Size of the ellipse that is drawn for a covariance."""
BROKEN_RING_PX = 14
"""Picture pixels: radius of the ring round a centre whose circle is not known."""


@dataclass(frozen=True, slots=True)
class CircleMark:
    """A position, with its circle and its covariance where they are known.

    Of a circle that is not known, a ring round the centre says where it is: it is broken, and as large on the screen at
    every zoom.
    """

    x_px: float
    y_px: float
    r_px: float | None
    ink: PaletteIndex
    covariance_px2: tuple[float, float, float] | None = None


@dataclass(frozen=True, slots=True)
class LineMark:
    """An open line through points."""

    points_px: tuple[tuple[float, float], ...]
    ink: PaletteIndex


@dataclass(frozen=True, slots=True)
class BoxMark:
    """The outline of a region."""

    region: Region
    ink: PaletteIndex


@dataclass(frozen=True, slots=True)
class PointMark:
    """A point with the ellipse of its covariance."""

    x_px: float
    y_px: float
    covariance_px2: tuple[float, float, float]
    ink: PaletteIndex


Mark = CircleMark | LineMark | BoxMark | PointMark


@dataclass(frozen=True, slots=True)
class PictureKey:
    """All that decides what a picture looks like, but for the recording."""

    camera: str
    window_us: tuple[int, int]
    """[start, end) of the events, or of the exposure."""
    frame: int | None
    """Number of the frame; None: events."""
    rendering: Rendering
    colours: PolarityColours
    region: Region
    width_px: int
    """About how wide the picture is to be; a sensor that is wider is binned when it is shown whole."""
    marks: tuple[Mark, ...]
    caption: str
    """Stands over it in real letters."""


@dataclass(frozen=True, slots=True)
class PicturePlan:
    """The pictures at one time."""

    t_us: int
    main: PictureKey
    overview: PictureKey
    others: tuple[PictureKey, ...]
    """The other cameras."""
    sides: SideLayout
    """Where the small pictures stand."""
    legend: tuple[tuple[str, PaletteIndex], ...] = ()
    """Whose label is which, where two are drawn in the large picture."""

    @property
    def shows_draft(self) -> bool:
        """Whether a proposal is drawn in the large picture."""
        return any(isinstance(mark, CircleMark) and mark.ink == PaletteIndex.DRAFT for mark in self.main.marks)


class PictureSource(Protocol):
    """Where pictures of one camera come from."""

    @property
    def size(self) -> SensorSize: ...
    def events(self, start_us: int, end_us: int) -> Events: ...
    def frame(self, number: int) -> NDArray[np.uint8]: ...


def draw_label_picture(source: PictureSource, key: PictureKey) -> bytes:
    """Draw what Label shows and encode it."""
    canvas, binning = _canvas(source.size, key)
    if key.frame is None:
        start_us, end_us = key.window_us
        window = Window(source.events(start_us, end_us), start_us, end_us)
        pixels = event_picture(window, key.rendering, binning=binning)
        if binning > 1:
            canvas = Canvas.of_binned(pixels, source.size, binning, across=canvas.across)
        else:
            canvas.paint_pixels(pixels)
        _draw_marks(canvas, key)
        return encode_png(canvas.image, key.colours)
    canvas.paint_frame(source.frame(key.frame))
    _draw_marks(canvas, key)
    return canvas.encode(key.colours)


def _canvas(size: SensorSize, key: PictureKey) -> tuple[Canvas, int]:
    across = round(TARGET_WIDTH_PX / key.width_px)
    binning = max(1, round(key.region.width / key.width_px))
    if binning > 1 and key.frame is None and key.region == Region.of_sensor(size):
        return Canvas(Region(0, 0, 8, 8), across=across), binning
    return Canvas(key.region, across=across, width_px=key.width_px), 1


def _draw_marks(canvas: Canvas, key: PictureKey) -> None:
    for mark in key.marks:
        if isinstance(mark, LineMark):
            canvas.draw_polygon(mark.points_px, mark.ink, closed=False)
        elif isinstance(mark, PointMark):
            canvas.draw_circle(mark.x_px, mark.y_px, 0.0, mark.ink)
            canvas.draw_ellipse(mark.x_px, mark.y_px, mark.covariance_px2, mark.ink, sigmas=SIGMAS)
        elif isinstance(mark, BoxMark):
            box = mark.region
            canvas.draw_box(box.x - 0.5, box.y - 0.5, box.x + box.width - 0.5, box.y + box.height - 0.5, mark.ink)
        else:
            thickness = 2 if canvas.scale >= 1 else 1
            if mark.r_px is None:
                canvas.draw_broken_ring(mark.x_px, mark.y_px, BROKEN_RING_PX, mark.ink, thickness=thickness)
            else:
                canvas.draw_circle(mark.x_px, mark.y_px, mark.r_px, mark.ink, thickness=thickness)
            if mark.covariance_px2 is not None:
                canvas.draw_ellipse(mark.x_px, mark.y_px, mark.covariance_px2, PaletteIndex.SIGMA, sigmas=SIGMAS)


WIDTH_PX: Final = 1280
STATUS_PX: Final = 38
"""Height of the line of text above the strip."""
STRIP_PX: Final = 36
HEIGHT_PX: Final = STATUS_PX + STRIP_PX
LETTER_PX, BETWEEN_PX = 16, 30
"""About how wide a letter, and the room between two words, is on the sheet where the window is smallest."""
PROPOSED_PX: Final = 10
"""Height of the lower part, which shows proposals."""
STATE_INKS: Final[dict[LabelState, PaletteIndex]] = {
    LabelState.VISIBLE: PaletteIndex.LABEL,
    LabelState.PARTLY_OCCLUDED: PaletteIndex.PARTLY,
    LabelState.OCCLUDED: PaletteIndex.OCCLUDED,
    LabelState.OUT_OF_FRAME: PaletteIndex.OUT_OF_FRAME,
    LabelState.NO_BALL: PaletteIndex.NO_BALL,
}


@dataclass(frozen=True, slots=True, eq=False)
class StripData:
    """What the strip shows; times ascend."""

    start_us: int
    end_us: int
    labels_us: NDArray[np.int64]
    states: NDArray[np.uint8]
    """Index into `labels.arrays.STATES`, one for each label."""
    proposed_us: NDArray[np.int64]
    contacts_us: tuple[int, ...]
    """Bounces, hits and net touches."""
    status: tuple[tuple[str, PaletteIndex], ...] = ()
    """Words of the line above, from left to right."""


def draw_strip(data: StripData, cursor_us: int, step_us: int) -> NDArray[np.uint8]:
    """(HEIGHT_PX, WIDTH_PX) palette indices; a label is as wide as the step between labels, at least a pixel."""
    whole = np.full((HEIGHT_PX, WIDTH_PX), PaletteIndex.BACKGROUND, np.uint8)
    image = whole[STATUS_PX:]
    image[:] = PaletteIndex.UNCHECKED
    inks = np.array([STATE_INKS[state] for state in STATES], np.uint8)
    _fill(image[: STRIP_PX - PROPOSED_PX], data, data.labels_us, inks[data.states], step_us)
    drafts = np.full(len(data.proposed_us), PaletteIndex.DRAFT, np.uint8)
    _fill(image[STRIP_PX - PROPOSED_PX + 2 :], data, data.proposed_us, drafts, step_us)
    for contact_us in data.contacts_us:
        image[:, _column(data, contact_us)] = PaletteIndex.EPIPOLAR
    at = _column(data, cursor_us)
    image[:, max(at - 1, 0) : at + 2] = PaletteIndex.CURSOR
    return whole


def status_texts(data: StripData, y_px: float, colours: PolarityColours) -> tuple[SheetText, ...]:
    """The words of the line above, whose middle is at `y_px` of the sheet, from left to right."""
    texts, x = [], 8.0
    for text, ink in data.status:
        texts.append(SheetText(x, y_px, text, css_colour(ink, colours), is_title=True))
        x += len(text) * LETTER_PX + BETWEEN_PX
    return tuple(texts)


def encode_strip(data: StripData, cursor_us: int, step_us: int, colours: PolarityColours) -> bytes:
    """The strip as a picture file."""
    return encode_png(draw_strip(data, cursor_us, step_us), colours)


def strip_time(data_start_us: int, data_end_us: int, share: float) -> int:
    """The time at a share 0..1 of the strip's width."""
    return round(data_start_us + share * (data_end_us - data_start_us))


def _column(data: StripData, t_us: int) -> int:
    span = max(data.end_us - data.start_us, 1)
    return min(max(round((t_us - data.start_us) / span * (WIDTH_PX - 1)), 0), WIDTH_PX - 1)


def _fill(
    rows: NDArray[np.uint8], data: StripData, t_us: NDArray[np.int64], inks: NDArray[np.uint8], step_us: int
) -> None:
    """Colour the columns from half a step before each time to half a step behind it; later times lie over earlier."""
    if not len(t_us):
        return
    span = max(data.end_us - data.start_us, 1)
    share = (np.stack([t_us - step_us / 2, t_us + step_us / 2]) - data.start_us) / span * (WIDTH_PX - 1)
    first, last = np.clip(np.round(share), 0, WIDTH_PX - 1).astype(np.int64)
    columns = np.arange(WIDTH_PX)
    row = np.searchsorted(first, columns, "right") - 1  # the last that begins there or before: it also ends last
    covered = (row >= 0) & (np.maximum(last, first + 1)[row] > columns)
    rows[:, covered] = inks[row[covered]]
