"""A film of the 3D view: pictures at equal steps of recording time, rendered by a browser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from app.export.selection import Span
from app.export.unfinished import Cancelled, Progress, check_cancelled, unfinished_file
from core.errors import CommandError
from core.extras import require_package

MAX_FRAMES: Final = 20_000
"""Most frames of a film; a browser draws about ten a second."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewFilmPlan:
    """Times of the film's pictures."""

    span: Span
    speed: float = 0.25
    """Recording seconds for each second of the film."""
    frames_per_s: float = 25.0
    width_px: int = 1280
    height_px: int = 720

    def times_us(self) -> tuple[int, ...]:
        """Recording time of each picture, from the start of the span.

        Raises:
            CommandError: if they are too many.
        """
        step_us = 1e6 * self.speed / self.frames_per_s
        count = max(1, int(self.span.length_us / step_us))
        if count > MAX_FRAMES:
            remedy = "take a shorter part, a higher speed, or fewer frames a second"
            raise CommandError("too long a film", expected=f"up to {MAX_FRAMES} frames", got=count, remedy=remedy)
        return tuple(self.span.start_us + round(number * step_us) for number in range(count))


def save_picture(path: Path, image: NDArray[np.uint8]) -> Path:
    """Write a picture (height, width, 3) RGB as PNG.

    Raises:
        CommandError: if it exists already, or cannot be written.
    """
    with unfinished_file(path, overwrite=False) as unfinished:
        Image.fromarray(image).save(unfinished, "PNG")
    return path


def export_view_film(
    path: Path,
    plan: ViewFilmPlan,
    picture_at: Callable[[int], NDArray[np.uint8]],
    *,
    progress: Progress = lambda share: None,
    cancelled: Cancelled = lambda: False,
) -> Path:
    """Write the film; `picture_at` draws a recording time as (height, width, 3) RGB.

    Raises:
        CommandError: if it is too long, exists already, or cannot be written, and whatever `picture_at` raises.
        ExportCancelledError: if `cancelled()` is true. There is no file then, as after every error.
    """
    require_package("av", "a film")
    from app.export.film_file import film_file  # the encoder is loaded only for a film

    times_us = plan.times_us()
    with film_file(path, width_px=plan.width_px, height_px=plan.height_px, frames_per_s=plan.frames_per_s) as film:
        for number, t_us in enumerate(times_us, start=1):
            check_cancelled(cancelled)
            film.write(picture_at(t_us))
            progress(number / len(times_us))
    return path
