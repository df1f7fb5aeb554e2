"""The pictures that lie beside files of labels: their sizes, which the files do not state."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from PIL import Image

from labels.formats.picture_names import stem_of

_SUFFIXES: Final = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})


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
                with Image.open(file) as picture:  # reads the header only
                    return picture.size
            except (OSError, ValueError, Image.DecompressionBombError):
                continue
        return None

    def _listed(self, folder: Path) -> dict[str, Path]:
        if folder not in self._folders:
            files = folder.iterdir() if folder.is_dir() else ()
            pictures = (file for file in files if file.suffix.lower() in _SUFFIXES and not file.name.startswith("."))
            self._folders[folder] = {stem_of(file.name): file for file in pictures}
        return self._folders[folder]
