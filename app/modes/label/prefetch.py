"""Pictures that are kept ready: what was shown a moment ago, and what the next steps will show."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass

from app.background.worker import LatestWins
from app.modes.label.label_picture import PictureKey, draw_label_picture
from app.modes.label.label_strip import HEIGHT_PX, STATUS_PX, StripData, encode_strip, status_texts
from app.modes.label.plan import MAIN_WIDTH_PX, SIDE_WIDTH_PX, PicturePlan
from app.modes.label.sources import LabelSource
from app.pictures.palette import PaletteIndex
from app.views.mosaic import Mosaic, MosaicTile, SheetText, css_colour

GAP_PX = 10
LINE_PX = 34
"""From one line of words to the next."""
KEPT = 256
"""Encoded pictures, some 10 to 40 kB each."""


@dataclass(frozen=True, slots=True, eq=False)
class MosaicRequest:
    """What one browser is to see."""

    plan: PicturePlan
    sources: Mapping[str, LabelSource]
    strip: StripData
    step_us: int


@dataclass(frozen=True, slots=True, eq=False)
class LabelMosaic:
    """The sheet, and which of its pictures is which."""

    sheet: Mosaic
    plan: PicturePlan
    main: MosaicTile
    strip: MosaicTile
    overview: MosaicTile


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

    def make_sheet(self, request: MosaicRequest) -> LabelMosaic:
        """All pictures of a request, laid out: the large one, the strip, then the whole and the other camera."""
        plan = request.plan
        main = self._place(plan.main, request, 0, 0, MAIN_WIDTH_PX)
        strip_png = encode_strip(request.strip, plan.t_us, request.step_us, plan.main.colours)
        y = main.height + GAP_PX
        strip = MosaicTile(strip_png, plan.main.region, 0, y, MAIN_WIDTH_PX, HEIGHT_PX)
        y += HEIGHT_PX + GAP_PX
        overview = self._place(plan.overview, request, 0, y, SIDE_WIDTH_PX)
        pictures = [main, strip, overview]
        texts = [
            _title(plan.main, main),
            *_legend(plan, main),
            *status_texts(request.strip, strip.y + STATUS_PX / 2, plan.main.colours),
        ]
        texts.append(_title(plan.overview, overview))
        if plan.partner is not None:
            x = MAIN_WIDTH_PX - SIDE_WIDTH_PX
            pictures.append(self._place(plan.partner, request, x, y, SIDE_WIDTH_PX))
            texts.append(_title(plan.partner, pictures[-1]))
        height = max(picture.y + picture.height for picture in pictures)
        return LabelMosaic(Mosaic(tuple(pictures), MAIN_WIDTH_PX, height, tuple(texts)), plan, main, strip, overview)

    def _place(self, key: PictureKey, request: MosaicRequest, x: int, y: int, width: int) -> MosaicTile:
        png = self.get(key, request.sources[key.camera])
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


@dataclass(frozen=True, slots=True, eq=False)
class _Request:
    plans: Callable[[], tuple[PicturePlan, ...]]
    sources: Mapping[str, LabelSource]


class Prefetcher:
    """Draws the neighbours of what is shown, one picture at a time, until something else is shown."""

    def __init__(self, pool: Executor, shelf: PictureCache, failed: Callable[[Exception], None]) -> None:
        self._registry = shelf
        self._number = 0
        self._work = LatestWins(pool, self._draw, lambda errand, answer: None, failed)

    def want(self, plans: Callable[[], tuple[PicturePlan, ...]], sources: Mapping[str, LabelSource]) -> None:
        """Make these ready, in their order; what was wanted before is forgotten. `plans` is called off the loop."""
        self._number += 1
        self._work.submit((self._number, _Request(plans, sources)))

    def pause(self) -> None:
        """Forget what was wanted; the picture that is being drawn is still finished."""
        self._number += 1

    def close(self) -> None:
        """Stop working ahead."""
        self._number += 1
        self._work.close()

    def _draw(self, errand: tuple[int, _Request]) -> None:
        number, wanted = errand
        for plan in wanted.plans():
            for key in (plan.main, plan.overview, plan.partner):
                if number != self._number:
                    return
                if key is not None and not self._registry.has(key):
                    self._registry.get(key, wanted.sources[key.camera])
