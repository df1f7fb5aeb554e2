"""What the documentation names of the code, its files and classes, is there under that name."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from typing import Final

import pytest

from tests.docs.markdown_pages import PAGES, ROOT

FOLDERS: Final = ("app", "core", "labels", "tests", "docs", "benchmarks")
_FILE: Final = re.compile(r"[\w./-]+\.py")
_CLASS: Final = re.compile(r"(?:\w+\.)*([A-Z][a-z]\w*[A-Z]\w*)(?:\(.*\))?")
"""Two words at least, such as `LabelStore`: a single one may be a button or a name from elsewhere."""


@cache
def code() -> tuple[frozenset[str], frozenset[str]]:
    """All files of the code, and all names of classes that it has or imports."""
    paths = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
    names: set[str] = set()
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                names.add(node.name)
            elif isinstance(node, ast.alias):
                names.add((node.asname or node.name).rpartition(".")[2])
    return frozenset(path.relative_to(ROOT).as_posix() for path in paths), frozenset(names)


def missing(text: str) -> Iterator[str]:
    """Files and classes that a page's words in code name and that are not there."""
    files, classes = code()
    for word in re.findall(r"`([^`\n]+)`", text):
        named = _CLASS.fullmatch(word)
        no_file = _FILE.fullmatch(word) and not any(f"/{file}".endswith(f"/{word}") for file in files)
        if no_file or (named and named[1] not in classes):
            yield word


def test_every_file_and_class_that_a_page_names_is_there() -> None:
    # The history names what was there then.
    pages = [page for page in PAGES if page.name != "CHANGELOG.md"]
    assert {page.name: found for page in pages if (found := [*missing(page.read_text(encoding="utf-8"))])} == {}


@pytest.mark.parametrize("gone", ["notices.py", "core/live/notices.py", "LiveRecording", "live.StateBelief(1)"])
def test_what_is_gone_is_found(gone: str) -> None:
    assert list(missing(f"See `{gone}`, `cameras.py`, `labels.store.LabelStore` and `detect`.")) == [gone]
