"""Reading the documentation's pages: their links, their anchors as GitHub makes them, and the commands they show."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [*(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")), *sorted(DOCS.rglob("*.md"))]
FENCE = re.compile(r"^( *)(```+|~~~+)[^\n]*\n(.*?)^\1\2 *$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\[(?:[^\[\]]|!\[[^\]]*\]\([^)]*\))*\]\(([^()\s]+)(?:\s+\"[^\"]*\")?\)")
IMAGE = re.compile(r"!\[[^\]]*\]\(([^()\s]+)\)")
HTML_TARGET = re.compile(r"<(?:a|img|source|video)\b[^>]*?\b(?:href|src)=\"([^\"]+)\"")
HEADING = re.compile(r"^#{1,6} +(.+?) *#* *$", re.MULTILINE)
SCRIPT = re.compile(r"^(?:\.venv/bin/|\.venv\\Scripts\\)?rallyscope\s+(?!=)(.*)$")
BENCH = re.compile(r"^((?:bench|train-detector)\s+[\w-].*)$")
"""A bench as prose names it, without the program before it."""


@dataclass(frozen=True)
class Target:
    """Where a link of a page leads."""

    page: Path
    link: str

    @property
    def is_local(self) -> bool:
        return re.match(r"[a-z][a-z0-9+.-]*:", self.link) is None

    @property
    def path(self) -> Path:
        """The file; the page itself for a mere anchor."""
        path = self.link.partition("#")[0]
        return (self.page.parent / path).resolve() if path else self.page

    @property
    def anchor(self) -> str:
        return self.link.partition("#")[2]


def without_code(text: str) -> str:
    """A page without its code, fenced or within a line: what looks like a link there is none."""
    return re.sub(r"(`+)(?!`).+?(?<!`)\1(?!`)", "``", FENCE.sub("", text), flags=re.DOTALL)


def targets_of(page: Path, text: str | None = None) -> list[Target]:
    """All links and pictures of a page."""
    prose = without_code(page.read_text(encoding="utf-8") if text is None else text)
    found = (pattern.findall(prose) for pattern in (LINK, IMAGE, HTML_TARGET))
    return [Target(page, link) for links in found for link in links]


def anchors_of(text: str) -> set[str]:
    """The anchors of a page's headings as GitHub makes them: small, no punctuation, a number where one comes again."""
    anchors: set[str] = set()
    for heading in HEADING.findall(FENCE.sub("", text)):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        anchor = re.sub(r"[^\w\- ]", "", plain).strip().replace(" ", "-")
        number, name = 0, anchor
        while name in anchors:
            number += 1
            name = f"{anchor}-{number}"
        anchors.add(name)
    return anchors


@dataclass(frozen=True)
class Shown:
    """A `rallyscope` command as a page shows it."""

    words: tuple[str, ...]
    """Its arguments."""
    whole: bool
    """In a block of code; within prose a command may leave out what is not spoken of."""


def commands_of(text: str) -> Iterator[Shown]:
    """Every `rallyscope` command of a page's code: the first of `a|b`, with and without `[...]`."""
    for block in FENCE.finditer(text):
        for line in re.sub(r"\\\n\s*", " ", block.group(3)).splitlines():
            yield from _shown(line, whole=True)
    for _, code in re.findall(r"(`+)(?!`)(.+?)(?<!`)\1(?!`)", FENCE.sub("", text), re.DOTALL):
        yield from _shown(" ".join(code.split()), whole=False)


def commands_of_code(text: str) -> Iterator[Shown]:
    """Every command between backticks of Python code, where 1 stands for what is put in."""
    joined = re.sub(r'"\s*\n\s*f?"', "", text)  # one string in several pieces
    for code in re.findall(r"(?<!`)`([^`\"]+)`(?!`)", joined):
        yield from _shown(re.sub(r"\{[^{}]*\}", "1", " ".join(code.split())), whole=False)


def _shown(line: str, *, whole: bool) -> Iterator[Shown]:
    line = line.strip().removeprefix("$ ")
    found = SCRIPT.match(line) or (None if whole else BENCH.match(line))
    if found is None:
        return
    shell = re.split(r"\s(?:#|&&|\||>)\s|\s{4,}", found.group(1) + " ")[0]
    for text in dict.fromkeys((re.sub(r"\[([^\[\]]*)\]", r" \1 ", shell), re.sub(r"\[[^\[\]]*\]", " ", shell))):
        words = (re.sub(r"^([\w.-]+)(\|[\w.-]+)+$", r"\1", word) for word in shlex.split(text.replace("\\", "/")))
        yield Shown(tuple(word for word in words if word not in ("...", "…")), whole)
