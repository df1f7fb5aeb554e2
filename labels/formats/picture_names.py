"""Which picture a name means: by our own time in it, by a table of times, or by its number, if that is unambiguous.

Tools rename pictures: Roboflow appends `_png.rf.<hash>.jpg`, Label Studio puts eight hex digits before, others add the
size. A number counts only if it stands alone and, over all names of an import, is the one part that varies.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Final

from core.errors import LabelError

_OURS: Final = re.compile(r"_t(\d{12,19})us(?![A-Za-z0-9])")
_SUFFIX: Final = re.compile(
    r"\.(png|jpe?g|jpe|bmp|tiff?|webp|gif|ppm|pgm|pnm|jp2|txt|xml|json|csv|npy)$", re.IGNORECASE
)
_ROBOFLOW: Final = re.compile(r"[._](png|jpe?g|bmp|tiff?|webp|gif)\.rf\.[0-9A-Za-z]+$", re.IGNORECASE)
_LABEL_STUDIO: Final = re.compile(r"^[0-9a-f]{8}-(?=.*\d)")
_TOKEN: Final = re.compile(r"[A-Za-z0-9]+")
_NUMBERED: Final = re.compile(r"([A-Za-z]*)(\d{1,18})")
FRAME_WORDS: Final = frozenset({"frame", "frames", "img", "image", "picture", "pic", "f", "fr", "im"})
LONGEST_TOKEN: Final = 24
"""A longer word of letters and digits is a hash."""


def stem_of(picture: str) -> str:
    """A picture's name without folders, without the endings of pictures and label files, and without a tool's hash."""
    stem = picture.strip().replace("\\", "/").rsplit("/", 1)[-1]
    while True:
        shorter = _ROBOFLOW.sub("", _SUFFIX.sub("", stem))
        if shorter == stem or not shorter:
            break
        stem = shorter
    return _LABEL_STUDIO.sub("", stem)


def own_time(stem: str) -> int | None:
    """The time that one of our own pictures has in its name."""
    found = set(map(int, _OURS.findall(stem)))
    return found.pop() if len(found) == 1 else None


class PictureNumbers:
    """The numbers of pictures, from all the names of an import together."""

    def __init__(self, names: Iterable[str]) -> None:
        self._numbers: dict[str, int] = {}
        self._reasons: dict[str, str] = {}
        parts = {stem: _numbers_of(stem) for stem in dict.fromkeys(map(stem_of, names)) if own_time(stem) is None}
        alike: dict[str, list[str]] = {}
        for stem, (skeleton, _) in parts.items():
            alike.setdefault(skeleton, []).append(stem)
        for stems in alike.values():
            self._decide(stems, parts)
        counts = Counter(self._numbers.values())
        for stem, number in list(self._numbers.items()):
            if counts[number] > 1:
                del self._numbers[stem]
                self._reasons[stem] = f"other pictures have the number {number} too"

    def number_of(self, picture: str) -> int:
        """The number of one of the names.

        Raises:
            LabelError: if its name does not tell.
        """
        stem = stem_of(picture)
        if stem in self._numbers:
            return self._numbers[stem]
        raise LabelError(
            f"which picture is it? {self._reasons.get(stem, 'no number in its name')}",
            got=repr(picture[:200]),
            remedy="--frame-times with the columns name,t_us tells",
        )

    def _decide(self, stems: list[str], parts: Mapping[str, tuple[str, list[tuple[str, int]]]]) -> None:
        """Choose the number of names that differ in their numbers only."""
        rows = [parts[stem][1] for stem in stems]
        words = [word for word, _ in rows[0]]
        varying = [k for k in range(len(words)) if len({row[k][1] for row in rows}) > 1]
        named = [k for k, word in enumerate(words) if word in FRAME_WORDS]
        if not words:
            reason, chosen = "no number stands alone in its name", None
        elif len(named) == 1 and varying in ([], named):
            chosen, reason = named[0], ""
        elif len(varying) == 1:
            chosen, reason = varying[0], ""
        elif len(words) == 1:
            chosen, reason = 0, ""
        elif len(named) == 1:
            chosen, reason = named[0], ""
        else:
            chosen, reason = None, f"{len(varying) or len(words)} numbers in its name, and it does not say which counts"
        for stem, row in zip(stems, rows, strict=True):
            if chosen is None:
                self._reasons[stem] = reason
            else:
                self._numbers[stem] = row[chosen][1]


def _numbers_of(stem: str) -> tuple[str, list[tuple[str, int]]]:
    """The name with its numbers taken out, and each of them with the word before it."""
    numbers: list[tuple[str, int]] = []
    before = ""

    def take(match: re.Match[str]) -> str:
        nonlocal before
        token = match[0]
        numbered = _NUMBERED.fullmatch(token)
        word, before = before, token.lower()
        if numbered is None or len(token) > LONGEST_TOKEN:
            return "?" if any(letter.isdigit() for letter in token) else token
        numbers.append((numbered[1].lower() or word, int(numbered[2])))
        return f"{numbered[1]}#"

    return _TOKEN.sub(take, stem), numbers
