"""The pictures that lie beside files of labels: their sizes, which the files do not state."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Final

from PIL import Image

from labels.formats.picture_names import stem_of

_SUFFIXES: Final = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})

_NO_PICTURE: Final = (OSError, ValueError, SyntaxError, Image.DecompressionBombError)
_ORIENTATION: Final = 0x112
"""EXIF tag of a picture's orientation."""
_LYING: Final = (5, 6, 7, 8)
"""Orientations of EXIF by which a picture is shown with its sides exchanged: labels are of what is shown
(cvat-ai/cvat#1059, HumanSignal/labelImg#376).
"""


def _shown_size(file: Path) -> tuple[int, int]:
    """Width and height as a viewer shows the picture; reads the header only."""
    with Image.open(file) as picture:
        width, height = picture.size
        lies = picture.getexif().get(_ORIENTATION) in _LYING
    return (height, width) if lies else (width, height)


class PictureFiles:
    """Finds pictures by their names; each folder is listed once."""

    def __init__(self) -> None:
        self._folders: dict[Path, dict[str, Path]] = {}

    def size_beside(self, text: Path) -> tuple[int, int] | None:
        """Width and height of the picture that a file of labels belongs to; None where none is found.

        It lies in the same folder, in `images` beside it, or where `labels` in the path is `images`.
        """
        folder = text.absolute().parent
        places = [folder, folder / "images", folder.parent / "images"]
        parts = list(folder.parts)
        if "labels" in parts:
            parts[len(parts) - 1 - parts[::-1].index("labels")] = "images"
            places.append(Path(*parts))
        for place in places:
            file = self._listed(place).get(stem_of(text.name))
            if file is None:
                continue
            try:
                return _shown_size(file)
            except _NO_PICTURE:
                continue
        return None

    def size_of_clip(self, table: Path) -> tuple[int, int] | None:
        """Width and height of the first picture of the clip that a table of TrackNet belongs to; None where none is.

        The pictures lie beside the table, or in `frame/CLIP` beside its folder, CLIP being its name without `_ball`.
        """
        folder, clip = table.absolute().parent, table.stem.removesuffix("_ball")
        roots = [root / name for root in (folder.parent, folder) for name in ("frame", "frames")]
        for place in [*(root / clip for root in roots), folder]:
            for file in sorted(self._listed(place).values())[:1]:
                with suppress(*_NO_PICTURE):
                    return _shown_size(file)
        return None

    def _listed(self, folder: Path) -> dict[str, Path]:
        if folder not in self._folders:
            files = folder.iterdir() if folder.is_dir() else ()
            pictures = (file for file in files if file.suffix.lower() in _SUFFIXES and not file.name.startswith("."))
            self._folders[folder] = {stem_of(file.name): file for file in pictures}
        return self._folders[folder]
