"""Which picture a name means: by our own time in it, by a table of times, or by its number, if that is unambiguous.

Tools rename pictures: Roboflow appends `_png.rf.<hash>.jpg`, Label Studio puts eight hex digits before, others add the
size. A number counts only if it stands alone and, over all names of an import, is the one part that varies. Names that
would mean the same picture, of two folders or two hashes, mean none: they are of two cameras or changed copies.
"""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Final
from urllib.parse import unquote

from core.errors import LabelError

_OURS: Final = re.compile(r"^(.*?)_t(\d{12,19})us(?![A-Za-z0-9])")
_OURS_ANYWHERE: Final = re.compile(r"_t(\d{12,19})us(?![A-Za-z0-9])")
_SUFFIX: Final = re.compile(
    r"\.(png|jpe?g|jpe|bmp|tiff?|webp|gif|ppm|pgm|pnm|jp2|txt|xml|json|csv|npy)$", re.IGNORECASE
)
_ROBOFLOW: Final = re.compile(r"[._](png|jpe?g|bmp|tiff?|webp|gif)\.rf\.[0-9A-Za-z]+$", re.IGNORECASE)
_LABEL_STUDIO: Final = re.compile(r"^[0-9a-f]{8}(?:-|__)(?=.*\d)")
_UUID: Final = re.compile(r"[0-9a-f]{8}([-_]?[0-9a-f]{4}){3}[-_]?[0-9a-f]{12}", re.IGNORECASE)
_NUMBER: Final = re.compile(r"\d+")
_TOKEN: Final = re.compile(r"[A-Za-z0-9]+")
_NUMBERED: Final = re.compile(r"([A-Za-z]*)(\d{1,18})")
FRAME_WORDS: Final = frozenset({"frame", "frames", "img", "image", "picture", "pic", "f", "fr", "im"})
OTHER_WORDS: Final = frozenset(
    {
        "cam", "camera", "c", "view", "stream", "rally", "rallies", "point", "match", "game", "set", "serve", "s",
        "seq", "sequence", "video", "vid", "clip", "take", "shot", "session", "run", "rec", "recording", "trial",
        "day", "player", "p", "part", "fold", "split", "aug", "augmented", "copy", "version", "ver", "v", "job",
        "task", "page",
    }
)  # fmt: skip
"""A number joined to one of these, in a name with several numbers, counts something else than pictures."""
NEVER_PICTURES: Final = frozenset({"cam", "camera", "view", "day", "player", "fold"})
"""A number joined to one of these counts something else also where it is the only one."""
LONGEST_TOKEN: Final = 24
"""A longer word of letters and digits is a hash."""


def stem_of(picture: str) -> str:
    """A picture's name without folders, without the endings of pictures and label files, and without a tool's hash."""
    stem = _last_part(picture)
    while True:
        shorter = _ROBOFLOW.sub("", _SUFFIX.sub("", stem))
        if shorter == stem or not shorter:
            break
        stem = shorter
    return stem if _UUID.match(stem) else _LABEL_STUDIO.sub("", stem)


def _last_part(picture: str) -> str:
    """The name without folders; one that a tool encoded for an address is decoded, but for ours, whose camera is so."""
    # macOS stores composed letters as two characters, a list from elsewhere has one (llmsresearch/paperbanana#234).
    name = unicodedata.normalize("NFC", picture.strip()).replace("\\", "/").rsplit("/", 1)[-1]
    if "%" in name and _OURS_ANYWHERE.search(name) is None:
        name = unicodedata.normalize("NFC", unquote(name)).replace("\\", "/").rsplit("/", 1)[-1]
    return name


def own_time(stem: str) -> int | None:
    """The time that one of our own pictures has in its name."""
    found = set(map(int, _OURS_ANYWHERE.findall(stem)))
    return found.pop() if len(found) == 1 else None


def own_camera(stem: str) -> str | None:
    """The camera that one of our own pictures has in its name; None if it is none of ours."""
    match = _OURS.match(stem)
    return None if match is None else unquote(match[1])


def other_camera_in(picture: str, camera: str, others: Sequence[str]) -> str | None:
    """Which of the other cameras a picture is of, by a word of its name or of its folders; None if none tells."""
    ours = own_camera(_last_part(picture))
    if ours is not None and ours in others and ours != camera:
        return ours
    words = {word.lower() for word in re.split(r"[^A-Za-z0-9]+", unquote(picture)) if word}
    if not camera or camera.lower() in words:
        return None
    return next((name for name in others if name.lower() in words), None)


class PictureNumbers:
    """The numbers of pictures, from all the names of an import together."""

    def __init__(self, names: Iterable[str]) -> None:
        self._numbers: dict[str, int] = {}
        self._reasons: dict[str, str] = {}
        self._families: dict[str, str] = {}
        self._copies = _copies(names := list(dict.fromkeys(names)))
        stems = [stem for stem in dict.fromkeys(map(stem_of, names)) if own_time(stem) is None]
        alike: dict[tuple[str, ...], list[str]] = {}
        for stem in stems:
            alike.setdefault(tuple(_TOKEN.split(_UUID.sub("uuid", stem))), []).append(stem)
        for group in alike.values():
            self._decide_alike(group)
        families: dict[int, set[str]] = {}
        for stem, number in self._numbers.items():
            families.setdefault(number, set()).add(self._families[stem])
        mixed = {family for found in families.values() if len(found) > 1 for family in found}
        counts = Counter(self._numbers.values())
        for stem, number in list(self._numbers.items()):
            if counts[number] > 1 or self._families[stem] in mixed:
                del self._numbers[stem]
                self._reasons[stem] = (
                    "pictures are named in two ways, with the same numbers"
                    if self._families[stem] in mixed
                    else f"other pictures have the number {number} too"
                )

    @property
    def known(self) -> tuple[int, ...]:
        """Every number that a name tells, ascending."""
        return tuple(sorted(self._numbers.values()))

    def refuse_copies(self, picture: str) -> None:
        """Check that a name is the only one of its picture.

        Raises:
            LabelError: if others mean the same one.
        """
        copies = self._copies.get(stem_of(picture))
        if copies is not None:
            raise LabelError(
                "several pictures have this name: two cameras, or copies that a tool has changed?",
                got=" and ".join(copies[:2])[:200],
                remedy="import the labels of one folder, or those of the original pictures",
            )

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

    def _decide_alike(self, stems: Sequence[str]) -> None:
        """Choose the numbers of names that are divided alike; what is a number in one and a hash in another is none."""
        rows = [[_number_in(token) for token in _TOKEN.findall(_UUID.sub("uuid", stem))] for stem in stems]
        hashed = {k for k in range(len(rows[0])) if any(row[k].hashed for row in rows)}
        groups: dict[tuple[str, ...], list[int]] = {}
        for at, row in enumerate(rows):
            kept = tuple("?" if k in hashed else f"{part.word}#" for k, part in enumerate(row))
            groups.setdefault(tuple(word if word != "#" else "#" for word in kept), []).append(at)
        for members in groups.values():
            columns = [k for k in range(len(rows[0])) if k not in hashed and rows[members[0]][k].number is not None]
            self._families |= {stems[at]: _NUMBER.sub("#", stems[at]) for at in members}
            self._decide([stems[at] for at in members], [rows[at] for at in members], columns)

    def _decide(self, stems: list[str], rows: list[list[_Part]], columns: list[int]) -> None:
        """Choose the number of names that differ in their numbers only."""
        numbers = [[row[k].number for k in columns] for row in rows]
        chosen, reason = _counting_column(rows[0], numbers, columns)
        for stem, row in zip(stems, numbers, strict=True):
            number = None if chosen is None else row[chosen]
            if number is None:
                self._reasons[stem] = reason
            else:
                self._numbers[stem] = number


def _counting_column(
    first: Sequence[_Part], numbers: Sequence[Sequence[int | None]], columns: Sequence[int]
) -> tuple[int | None, str]:
    """Which of a name's numbers counts pictures, None if none does for sure, and the reason then.

    Args:
        first: the words of one of the names; the others differ in numbers only.
        numbers: of each name, those of its words that are numbers.
        columns: at which words they stand.
    """
    if not columns:
        return None, "no number stands alone in its name"
    places = range(len(columns))
    joined = [first[k].word.lower() for k in columns]
    words = [first[k].word.lower() or (first[k - 1].text.lower() if k else "") for k in columns]
    varying = [k for k in places if len({row[k] for row in numbers}) > 1]
    named = [k for k in places if words[k] in FRAME_WORDS]
    other = _counts_of_something_else(joined, words)
    possible = [k for k in places if k not in other]
    if not possible or any(k in other for k in varying if len(named) != 1 or joined[k] in NEVER_PICTURES):
        return None, "the number that varies counts something else than pictures"
    if len(named) == 1:
        return named[0], ""
    if len(varying) == 1:
        return varying[0], ""
    if len(possible) == 1 and not varying and all(joined[k] for k in other):  # a single picture, or copies of one
        return possible[0], ""
    return None, f"{len(varying) or len(columns)} numbers in its name, and it does not say which counts"


def _counts_of_something_else(joined: Sequence[str], words: Sequence[str]) -> set[int]:
    """Places of numbers that count no pictures: the 2 of "cam2_000005", or that of "rally 2" before another number."""
    last = len(words) - 1
    return {
        k
        for k, (letters, word) in enumerate(zip(joined, words, strict=True))
        if letters in NEVER_PICTURES or (last > 0 and letters in OTHER_WORDS) or (word in OTHER_WORDS and k < last)
    }


class _Part:
    """One word of a name: text, or a number with the letters that it is joined to."""

    __slots__ = ("hashed", "number", "text", "word")

    def __init__(self, text: str, word: str, number: int | None, *, hashed: bool) -> None:
        self.text, self.word, self.number, self.hashed = text, word, number, hashed


def _number_in(token: str) -> _Part:
    numbered = _NUMBERED.fullmatch(token)
    if numbered is not None and len(token) <= LONGEST_TOKEN:
        return _Part(token, numbered[1], int(numbered[2]), hashed=False)
    hashed = any(letter.isdigit() for letter in token)
    return _Part(token, token, None, hashed=hashed)


def _copies(names: Iterable[str]) -> dict[str, list[str]]:
    """Names of different pictures that have the same stem, by that."""
    found: dict[str, dict[str, str]] = {}
    for name in names:
        path = name.strip().replace("\\", "/")
        while (shorter := _SUFFIX.sub("", path)) not in ("", path):
            path = shorter
        found.setdefault(stem_of(name), {}).setdefault(path, name)
    return {stem: list(paths.values()) for stem, paths in found.items() if len(paths) > 1}
