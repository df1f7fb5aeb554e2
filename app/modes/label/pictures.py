"""The pictures of one browser in Label: those at the cursor, drawn in the background, then their neighbours."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from typing import Final

from app.background.worker import LatestWins
from app.modes.label.editor import LabelEditor
from app.modes.label.label_strip import StripData
from app.modes.label.plan import LabelScene, PicturePlan, Point, centre_at, plan_at
from app.modes.label.prefetch import LabelMosaic, MosaicRequest, PictureCache, Prefetcher
from app.pictures.palette import PaletteIndex

READY_STEPS: Final = (1, 2, 3, -1, 4, 5, 6, -2, 10, -10)
"""Neighbours that are drawn before they are asked for."""
Words = tuple[tuple[str, PaletteIndex], ...]
Drawing = Callable[[], tuple[LabelEditor, LabelMosaic]]


class LabelPictures:
    """Draws what one editor's cursor points at. Methods are called by the loop; `drawn` is called by another thread."""

    def __init__(
        self,
        pool: Executor,
        drawn: Callable[[LabelEditor, LabelMosaic], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self._pool, self._failed = pool, failed
        self._work = LatestWins(pool, _draw, lambda ask, answer: drawn(*answer), failed)
        self._cache = PictureCache()
        self._ahead = Prefetcher(pool, self._cache, failed)
        self._next: Callable[[], tuple[PicturePlan, ...]] | None = None
        """Makes what should be drawn ahead, once what is asked for is shown."""
        self.shown: LabelMosaic | None = None
        self._centre: Point | None = None
        self._arrival: object = None
        self._asked: object = None

    @property
    def busy(self) -> bool:
        """Whether what was asked for is still being drawn."""
        return self._work.busy

    def begin(self) -> None:
        """Another recording is labelled."""
        self._cache = PictureCache()
        self._ahead.close()
        self._ahead = Prefetcher(self._pool, self._cache, self._failed)
        self._centre = self._arrival = self._asked = self.shown = None

    def ask_again(self) -> None:
        """What was drawn is no longer on the screen."""
        self._asked = None

    def close(self) -> None:
        """The browser is gone."""
        self._work.close()
        self._ahead.close()

    def arrives(self, scene: LabelScene, t_us: int) -> bool:
        """Whether the cursor has come to another place; the zoomed picture follows it.

        Proposals that come in the meantime do not move it: a click or drag may be on its way.
        """
        view = scene.view
        arrival = (t_us, view.camera, view.zoom, view.blind, view.follow, view.centre_px)
        if arrival == self._arrival:
            return False
        self._arrival = arrival
        self._centre = centre_at(scene, t_us, self._centre)
        return True

    def look_at(self, point: Point) -> None:
        """The middle of the zoomed picture from now on."""
        self._centre, self._arrival = point, None

    def ask(self, editor: LabelEditor, scene: LabelScene, words: Words) -> None:
        """Draw what is to be seen now, unless that was asked for; then its neighbours."""
        now, centre = editor.labelling, self._centre
        assert centre is not None
        plan = plan_at(scene, now.t_us, centre)
        arrays, proposals = now.here.arrays, now.here.proposals
        known = (plan, arrays, proposals, now.breaks_us, now.step_us, words)
        if known == self._asked:
            return
        self._asked = known
        proposed_us = proposals.t_us if proposals is not None else arrays.t_us[:0]
        strip = StripData(0, now.recording.duration_us, arrays.t_us, arrays.state, proposed_us, now.breaks_us, words)
        request, cache = MosaicRequest(plan, now.sources, strip, now.step_us), self._cache
        self._ahead.pause()  # what is asked for now comes first
        self._work.submit(lambda: (editor, cache.make_sheet(request)))
        self._next = None if scene.ring else lambda: _neighbours(scene, now.grid.moved, plan.t_us, centre)

    def show(self, mosaic: LabelMosaic, editor: LabelEditor) -> None:
        """It is on the screen; its neighbours are drawn now."""
        self.shown = mosaic
        if self._next is not None:
            self._ahead.want(self._next, editor.labelling.sources)
            self._next = None


def _draw(ask: Drawing) -> tuple[LabelEditor, LabelMosaic]:
    return ask()


def _neighbours(
    scene: LabelScene, moved: Callable[[int, int], int], t_us: int, centre: Point
) -> tuple[PicturePlan, ...]:
    """What the next steps will show, the likeliest first."""
    plans = []
    for steps in READY_STEPS:
        at_us = moved(t_us, steps)
        plans.append(plan_at(scene, at_us, centre_at(scene, at_us, centre)))
    return tuple(plans)
