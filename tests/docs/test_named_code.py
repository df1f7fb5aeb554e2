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
_MODULE: Final = re.compile(rf"({'|'.join(FOLDERS)})(\.\w+)+")
_CLASS: Final = re.compile(r"(?:\w+\.)*([A-Z][a-z]\w*[A-Z]\w*)(?:\(.*\))?")
"""Two words at least, such as `LabelStore`: a single one may be a button or a name from elsewhere."""
_BLOCK: Final = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_NAME: Final = re.compile(r"(?<![\w.\"'])([A-Z][a-z]+[A-Z][a-z]\w*)")
_IMPORTED: Final = re.compile(r"import ([\w, ]+)")


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
    """Files, modules and classes that a page's words and blocks in code name and that are not there."""
    files, classes = code()
    for word in re.findall(r"`([^`\n]+)`", text):
        named = _CLASS.fullmatch(word)
        no_file = _FILE.fullmatch(word) and not any(f"/{file}".endswith(f"/{word}") for file in files)
        if no_file or (named and named[1] not in classes) or (_MODULE.fullmatch(word) and not is_module(word)):
            yield word
    for block in (block for language, block in _BLOCK.findall(text) if language in ("", "python")):
        theirs = {name for names in _IMPORTED.findall(block) for name in re.findall(r"\w+", names)}
        yield from (name for name in _NAME.findall(block) if name not in classes | theirs)


def is_module(word: str) -> bool:
    """Whether a name with dots is that of a module or a package, or of what one of them has."""
    files, _ = code()
    path = word.replace(".", "/")
    return any(file.startswith((f"{one}.py", f"{one}/")) for file in files for one in (path, path.rpartition("/")[0]))


def test_every_file_and_class_that_a_page_names_is_there() -> None:
    # The history names what was there then.
    pages = [page for page in PAGES if page.name != "CHANGELOG.md"]
    assert {page.name: found for page in pages if (found := [*missing(page.read_text(encoding="utf-8"))])} == {}


GONE: Final = ("notices.py", "core/live/notices.py", "LiveRecording", "live.StateBelief(1)", "app.gone.far_away")


@pytest.mark.parametrize("gone", GONE)
def test_what_is_gone_is_found(gone: str) -> None:
    assert list(missing(f"See `{gone}`, `cameras.py`, `labels.store.LabelStore` and `detect`.")) == [gone]


def test_what_a_block_of_code_names_is_looked_for_unless_the_block_imports_it() -> None:
    page = "```python\nfrom onnxruntime import InferenceSession\nInferenceSession(LabelStore(), LiveRecording())\n```"
    assert list(missing(page)) == ["LiveRecording"]
