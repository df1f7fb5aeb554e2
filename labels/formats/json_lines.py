"""JSON whose objects know the line they stand on, so that a rejection can name it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator

from core.errors import LabelError

_TOKENS = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\n]', re.DOTALL)


class JsonObject(dict[str, object]):
    """A JSON object; `line` is where it begins."""

    line: int = 1


class JsonError(LabelError):
    """Text that is not JSON."""

    def __init__(self, what: str, line: int) -> None:
        super().__init__(what)
        self.line = line


def parse_json(text: str) -> object:
    """The value, with objects as `JsonObject`.

    Raises:
        JsonError: if the text is not JSON.
    """
    lines = _lines_of_objects(text)

    def make(pairs: list[tuple[str, object]]) -> JsonObject:
        made = JsonObject(pairs)
        made.line = next(lines, 1)
        return made

    try:
        return json.loads(text, object_pairs_hook=make)
    except json.JSONDecodeError as error:
        raise JsonError(f"not JSON: {error.msg}", error.lineno) from error
    except (RecursionError, ValueError) as error:
        raise JsonError(f"not JSON that can be read: {error}", 1) from error


def _lines_of_objects(text: str) -> Iterator[int]:
    """The line on which each object begins, in the order in which they end: the order in which a parser makes them."""
    line, open_lines = 1, []
    for token in _TOKENS.finditer(text):
        match token[0]:
            case "\n":
                line += 1
            case "{":
                open_lines.append(line)
            case "}":
                yield open_lines.pop() if open_lines else line
            case string:
                line += string.count("\n")
