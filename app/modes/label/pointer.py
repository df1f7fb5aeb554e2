"""The mouse on the pictures of Label: it places a ball, draws a circle, or chooses a place, a time or a camera."""

from __future__ import annotations

import math

from app.modes.label.by_hand import place_ball
from app.modes.label.editor import LabelEditor
from app.modes.label.label_picture import strip_time
from app.modes.label.labelling import ZOOMS, Point
from app.modes.label.pictures import LabelPictures
from app.views.image_view import DragPhase


class LabelPointer:
    """Clicks and drags of one browser, at points of the sheet. Methods are called by the loop."""

    def __init__(self, pictures: LabelPictures) -> None:
        self._pictures = pictures
        self.ring: tuple[float, float, float] | None = None
        """The circle that is being drawn: column, row and radius, px."""
        self.looks = False
        """Whether a person has chosen the middle of the zoomed picture since the last turn of the loop."""

    def click(self, editor: LabelEditor, x: float, y: float) -> None:
        """The ball is here; in the strip or the overview: look there; in another camera's picture: label that."""
        shown = self._pictures.shown
        if shown is None:
            return
        if (point := shown.main.sensor_point(x, y)) is not None:
            editor.do(lambda editor: place_ball(editor, *point))
        elif shown.strip.sensor_point(x, y) is not None:
            share = (x - shown.strip.x) / shown.strip.width
            editor.go_to(strip_time(0, editor.labelling.recording.duration_us, share))
        elif (point := shown.overview.sensor_point(x, y)) is not None:
            self.look_at(editor, point)
        else:
            for camera, tile in shown.others:
                if tile.sensor_point(x, y) is not None:
                    editor.change_view({"camera": camera})

    def look_at(self, editor: LabelEditor, point: Point) -> None:
        """Zoom in on a point of the sensor, px."""
        editor.change_view({"centre_px": point, "zoom": max(editor.labelling.view.zoom, ZOOMS[1])})
        self._pictures.look_at(point)
        self.looks = True

    def drag(self, editor: LabelEditor, phase: DragPhase, start: Point, end: Point) -> None:
        """From the centre to the rim."""
        shown = self._pictures.shown
        if shown is None:
            return
        centre, rim = shown.main.sensor_point(*start), shown.main.sensor_point(*end)
        self.ring = None
        if centre is None or rim is None:
            return
        r_px = math.dist(centre, rim)
        if phase == "end":
            editor.do(lambda editor: place_ball(editor, *centre, r_px))
        else:
            self.ring = (*centre, r_px)
