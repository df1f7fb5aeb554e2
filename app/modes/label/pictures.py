"""The pictures of one browser in Label: those at the cursor, drawn in the background, and neighbours kept ready."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Final

from app.background.jobs import LatestWins
from app.modes.label.editor import LabelEditor
from app.modes.label.label_picture import (
    GAP_PX,
    HEIGHT_PX,
    MAIN_WIDTH_PX,
    STATUS_PX,
    PictureKey,
    PicturePlan,
    StripData,
    draw_label_picture,
    encode_strip,
    status_texts,
)
from app.modes.label.labelling import Labelling, Point
from app.modes.label.plan import LabelScene, centre_at, plan_at
from app.modes.label.sources import LabelSource
from app.pictures.palette import PaletteIndex
from app.views.freshness import AnswerFreshness
from app.views.mosaic import Mosaic, MosaicTile, SheetText, css_colour

READY_STEPS: Final = (1, 2, 3, -1, 4, 5, 6, -2, 10, -10)
"""Neighbours that are drawn before they are asked for."""
LINE_PX = 34
"""From one line of words to the next."""
KEPT = 256
"""Encoded pictures, some 10 to 40 kB each."""
Words = tuple[tuple[str, PaletteIndex], ...]


@dataclass(frozen=True, slots=True, eq=False)
class LabelMosaic:
    """The sheet, and which of its pictures is which."""

    sheet: Mosaic
    plan: PicturePlan
    main: MosaicTile
    strip: MosaicTile
    overview: MosaicTile
    others: tuple[tuple[str, MosaicTile], ...]
    """The other cameras' names and pictures."""


class PictureCache:
    """Encoded pictures by their key; safe to use from several threads."""

    def __init__(self) -> None:
        self._pngs: OrderedDict[PictureKey, bytes] = OrderedDict()
        self._lock = threading.Lock()

    def has(self, key: PictureKey) -> bool:
        """Whether it is ready."""
        return key in self._pngs

    def get(self, key: PictureKey, source: LabelSource) -> bytes:
        """The picture, drawn now if it is not ready."""
        with self._lock:
            if key in self._pngs:
                self._pngs.move_to_end(key)
                return self._pngs[key]
        png = draw_label_picture(source, key)
        with self._lock:
            self._pngs[key] = png
            while len(self._pngs) > KEPT:
                self._pngs.popitem(last=False)
        return png

    def make_sheet(self, plan: PicturePlan, now: Labelling, strip_data: StripData) -> LabelMosaic:
        """All pictures of a plan, laid out: the large one, the strip, then the whole and the other cameras."""
        main = self._place(plan.main, now, 0, 0, MAIN_WIDTH_PX)
        strip_png = encode_strip(strip_data, plan.t_us, now.step_us, plan.main.colours)
        y = main.height + GAP_PX
        strip = MosaicTile(strip_png, plan.main.region, 0, y, MAIN_WIDTH_PX, HEIGHT_PX)
        y += HEIGHT_PX + GAP_PX
        small: list[MosaicTile] = []
        sides = plan.sides
        left, top = (MAIN_WIDTH_PX + GAP_PX, 0) if sides.beside else (0, y)
        for number, key in enumerate((plan.overview, *plan.others)):
            column = number % sides.columns
            if number and not column:
                top = max(tile.y + tile.height for tile in small) + GAP_PX
            small.append(self._place(key, now, left + column * (sides.width_px + GAP_PX), top, sides.width_px))
        pictures = [main, strip, *small]
        texts = [
            _title(plan.main, main),
            *_legend(plan, main),
            *status_texts(strip_data, strip.y + STATUS_PX / 2, plan.main.colours),
        ]
        texts += [_title(key, tile) for key, tile in zip((plan.overview, *plan.others), small, strict=True)]
        width = max(picture.x + picture.width for picture in pictures)
        height = max(picture.y + picture.height for picture in pictures)
        others = tuple((key.camera, tile) for key, tile in zip(plan.others, small[1:], strict=True))
        sheet = Mosaic(tuple(pictures), width, height, tuple(texts))
        return LabelMosaic(sheet, plan, main, strip, small[0], others)

    def _place(self, key: PictureKey, now: Labelling, x: int, y: int, width: int) -> MosaicTile:
        png = self.get(key, now.sources[key.camera])
        height = round(width * key.region.height / key.region.width)
        return MosaicTile(png, key.region, x, y, width, height)


def _title(key: PictureKey, tile: MosaicTile) -> SheetText:
    return SheetText(tile.x + 8, tile.y + 20, key.caption, css_colour(PaletteIndex.TEXT, key.colours), is_title=True)


def _legend(plan: PicturePlan, tile: MosaicTile) -> list[SheetText]:
    x, y, colours = tile.x + 8, tile.y + 20 + LINE_PX, plan.main.colours
    return [
        SheetText(x, y + row * LINE_PX, text, css_colour(ink, colours), is_title=True)
        for row, (text, ink) in enumerate(plan.legend)
    ]


class Prefetcher:
    """Draws the neighbours of what is shown, one picture at a time, until something else is shown."""

    def __init__(self, pool: Executor, cache: PictureCache, failed: Callable[[Exception], None]) -> None:
        self._cache = cache
        self._number = 0
        """Number of the latest request; older ones stop."""
        self._work = LatestWins(pool, self._draw, lambda request, answer: None, failed)

    def want(self, scene: LabelScene, t_us: int, centre: Point) -> None:
        """Make the pictures ready that the next steps will show, instead of those that were wanted before."""
        self._number += 1
        self._work.submit((self._number, scene, t_us, centre))

    def pause(self) -> None:
        """Forget what was wanted; the picture that is being drawn is still finished."""
        self._number += 1

    def close(self) -> None:
        """Stop working ahead."""
        self._number += 1
        self._work.close()

    def _draw(self, request: tuple[int, LabelScene, int, Point]) -> None:
        number, scene, t_us, centre = request
        for plan in neighbours(scene, t_us, centre):
            for key in (plan.main, plan.overview, *plan.others):
                if number != self._number:
                    return
                if not self._cache.has(key):
                    self._cache.get(key, scene.now.sources[key.camera])


def neighbours(scene: LabelScene, t_us: int, centre: Point) -> tuple[PicturePlan, ...]:
    """What the next steps will show, the likeliest first."""
    times = [scene.now.grid.moved(t_us, steps) for steps in READY_STEPS]
    return tuple(plan_at(scene, at_us, centre_at(scene, at_us, centre)) for at_us in times)


class LabelPictures:
    """Draws what one editor's cursor points at. Methods are called by the loop; `drawn` is called by another thread."""

    def __init__(
        self,
        pool: Executor,
        drawn: Callable[[object, LabelEditor, LabelMosaic], None],
        failed: Callable[[Exception], None],
        freshness: AnswerFreshness,
    ) -> None:
        """`drawn` gets the request, the editor and the pictures; `freshness` notes the requests."""
        self._pool, self._failed, self._freshness = pool, failed, freshness
        self._work: LatestWins[Callable[[], tuple[LabelEditor, LabelMosaic]], tuple[LabelEditor, LabelMosaic]]
        self._work = LatestWins(pool, lambda draw: draw(), lambda draw, answer: drawn(draw, *answer), failed)
        self._cache = PictureCache()
        self._ahead = Prefetcher(pool, self._cache, failed)
        self._next: tuple[LabelScene, int, Point] | None = None
        """Whose neighbours are drawn ahead, once it is shown."""
        self.shown: LabelMosaic | None = None
        self._centre: Point | None = None
        self._arrival: object = None
        self._asked: object = None
        self._planned: object = None

    @property
    def busy(self) -> bool:
        """Whether what was asked for is still being drawn."""
        return self._work.busy

    @property
    def centre(self) -> Point:
        """The middle of the zoomed picture; known once the cursor has arrived anywhere."""
        assert self._centre is not None
        return self._centre

    def begin(self) -> None:
        """Another recording is labelled."""
        self._cache = PictureCache()
        self._ahead.close()
        self._ahead = Prefetcher(self._pool, self._cache, self._failed)
        self._centre = self._arrival = self._asked = self._planned = self.shown = None

    def ask_again(self) -> None:
        """What was drawn is no longer on the screen."""
        self._asked = self._planned = None

    def close(self) -> None:
        """The browser is gone."""
        self._work.close()
        self._ahead.close()

    def arrives(self, scene: LabelScene, t_us: int) -> bool:
        """Whether the cursor has come to another place; the zoomed picture follows it.

        Proposals that come in the meantime do not move it: a click or drag may be on its way.
        """
        view = scene.now.view
        arrival = (t_us, view.camera, view.zoom, view.repeat, view.follow, view.centre_px)
        if arrival == self._arrival:
            return False
        self._arrival = arrival
        self._centre = centre_at(scene, t_us, self._centre)
        return True

    def move_to(self, point: Point) -> None:
        """The middle of the zoomed picture until the cursor comes to another place."""
        self._centre = point

    def look_at(self, point: Point) -> None:
        """The middle of the zoomed picture from now on."""
        self._centre, self._arrival = point, None

    def ask(self, editor: LabelEditor, scene: LabelScene, words: Words, wall_s: float) -> None:
        """Draw what is to be seen now, unless that was asked for; then its neighbours."""
        now, centre = scene.now, self._centre
        assert centre is not None
        planned = (now.t_us, centre, now.view, now.works, now.compared, now.asking, now.contacts, now.step_us)
        planned = (*planned, scene.rendering, scene.colours, scene.ring, scene.aspect, words)
        if planned == self._planned:  # nothing has changed since the last turn: no ray has to be drawn again
            return
        self._planned = planned
        plan = plan_at(scene, now.t_us, centre)
        arrays, proposals = now.here.arrays, now.here.proposals
        known = (plan, arrays, proposals, now.contacts, now.step_us, words)
        if known == self._asked:
            return
        self._asked = known
        proposed_us = proposals.t_us if proposals is not None else arrays.t_us[:0]
        contacts_us = tuple(contact.t_us for contact in now.contacts)
        strip = StripData(0, now.recording.duration_us, arrays.t_us, arrays.state, proposed_us, contacts_us, words)
        cache = self._cache
        self._ahead.pause()  # what is asked for now comes first

        def draw() -> tuple[LabelEditor, LabelMosaic]:
            return editor, cache.make_sheet(plan, now, strip)

        self._freshness.ask(draw, wall_s)
        self._work.submit(draw)
        self._next = None if scene.ring else (scene, plan.t_us, centre)

    def show(self, mosaic: LabelMosaic) -> None:
        """It is on the screen; its neighbours are drawn now."""
        self.shown = mosaic
        if self._next is not None:
            self._ahead.want(*self._next)
            self._next = None
