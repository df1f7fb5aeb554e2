"""Single mutants of Python source: found in the syntax tree, applied to the text, so that nothing else changes.

What is left out says nothing about tests: annotations, docstrings, messages of errors and logs, assertions of our own
invariants, `strict=` of zip, and the fields of configurations, whose defaults are choices with a reason beside them.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass

COMPARISONS = {
    ast.Lt: ("<", ("<=", ">=")),
    ast.LtE: ("<=", ("<", ">")),
    ast.Gt: (">", (">=", "<=")),
    ast.GtE: (">=", (">", "<")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: ("is not", ("is",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: ("not in", ("in",)),
}
OPERATORS = {
    ast.Add: ("+", ("-",)),
    ast.Sub: ("-", ("+",)),
    ast.Mult: ("*", ("/",)),
    ast.Div: ("/", ("*",)),
    ast.FloorDiv: ("//", ("*",)),
    ast.Mod: ("%", ("*",)),
    ast.Pow: ("**", ("*",)),
    ast.BitAnd: ("&", ("|",)),
    ast.BitOr: ("|", ("&",)),
    ast.BitXor: ("^", ("&",)),
    ast.LShift: ("<<", (">>",)),
    ast.RShift: (">>", ("<<",)),
}
SWAPPED = {"min": "max", "minimum": "maximum", "argmin": "argmax", "any": "all", "floor": "ceil", "sin": "cos"}
SWAPPED |= {other: one for one, other in SWAPPED.items()}
SILENT_CALLS = {"debug", "info", "warning", "error", "exception", "field", "setting", "TypeVar", "warn"}
SILENT_KEYWORDS = {"strict", "where", "expected", "got", "remedy", "said"}


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change of one file."""

    path: str
    """Relative to the root."""
    kind: str
    line: int
    start: int
    end: int
    """Characters of the text that are replaced."""
    new: str

    def apply(self, text: str) -> str:
        """The file's text with the change."""
        return text[: self.start] + self.new + text[self.end :]

    def lines(self, text: str) -> tuple[str, str]:
        """The line, or lines, of the change before and after, stripped: how a mutant is named for good."""
        first = text.rfind("\n", 0, self.start) + 1
        last = text.find("\n", self.end)
        last = len(text) if last < 0 else last
        after = text[first : self.start] + self.new + text[self.end : last]
        return text[first:last].strip(), after.strip()


def find_mutants(path: str, text: str) -> list[Mutant]:
    """All mutants of a file, by place."""
    starts = [0]
    for row in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(row))
    rows = text.splitlines(keepends=True)

    def at(line: int, column: int) -> int:
        return starts[line - 1] + len(rows[line - 1].encode()[:column].decode())  # ast counts bytes

    def span(node: ast.AST) -> tuple[int, int]:
        return at(node.lineno, node.col_offset), at(node.end_lineno, node.end_col_offset)  # type: ignore[attr-defined]

    found = []
    for node in _living(ast.parse(text), False):
        for kind, start, end, new in _changes(node, text, span):
            if text[start:end] != new:
                found.append(Mutant(path, kind, text.count("\n", 0, start) + 1, start, end, new))
    return sorted(found, key=lambda one: (one.start, one.end, one.new))


def _living(node: ast.AST, in_class: bool) -> Iterator[ast.AST]:
    """The nodes whose change a test should see."""
    if isinstance(node, ast.Assert | ast.Raise | ast.Import | ast.ImportFrom | ast.JoinedStr):
        return
    if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
        return
    if isinstance(node, ast.Call) and _name(node.func) in SILENT_CALLS:
        return
    if isinstance(node, ast.keyword) and node.arg in SILENT_KEYWORDS:
        return
    if in_class and isinstance(node, ast.AnnAssign | ast.Assign):
        return
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params", "bases"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _living(child, isinstance(node, ast.ClassDef))


def _name(node: ast.AST) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _changes(  # noqa: C901 (a table of cases, one for each kind of node)
    node: ast.AST, text: str, span
) -> Iterator[tuple[str, int, int, str]]:
    if isinstance(node, ast.Compare):
        for left, operator, right in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
            old, others = COMPARISONS[type(operator)]
            yield from _between("comparison", text, span(left)[1], span(right)[0], old, others)
    elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        if not (isinstance(node.left, ast.Constant | ast.JoinedStr) and isinstance(_value(node.left), str)):
            old, others = OPERATORS[type(node.op)]
            yield from _between("arithmetic", text, span(node.left)[1], span(node.right)[0], old, others)
    elif isinstance(node, ast.AugAssign) and type(node.op) in OPERATORS:
        old, others = OPERATORS[type(node.op)]
        others = tuple(f"{other}=" for other in others)
        yield from _between("arithmetic", text, span(node.target)[1], span(node.value)[0], f"{old}=", others)
    elif isinstance(node, ast.BoolOp):
        old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in zip(node.values, node.values[1:], strict=False):
            yield from _between("boolean", text, span(left)[1], span(right)[0], old, (new,))
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub | ast.Invert):
        start, end = span(node)
        yield "unary", start, end, text[start + (3 if isinstance(node.op, ast.Not) else 1) : end].lstrip()
    elif isinstance(node, ast.Constant):
        yield from _constants(node, text, span)
    elif isinstance(node, ast.Call) and _name(node.func) in SWAPPED:
        start, end = span(node.func)
        name = _name(node.func)
        yield "function", end - len(name), end, SWAPPED[name]
    elif isinstance(node, ast.Return) and node.value is not None and _value(node.value) is not None:
        for new in ("None", "0"):
            yield "return", *span(node.value), new
    elif isinstance(node, ast.Slice):
        for part, sign in ((node.lower, "+"), (node.upper, "-")):
            if part is not None:
                start, end = span(part)
                yield "slice", start, end, f"({text[start:end]}) {sign} 1"
    elif isinstance(node, ast.If | ast.While | ast.IfExp):
        start, end = span(node.test)
        yield "condition", start, end, f"(not ({text[start:end]}))"


def _value(node: ast.AST) -> object:
    return node.value if isinstance(node, ast.Constant) else node


def _constants(node: ast.Constant, text: str, span) -> Iterator[tuple[str, int, int, str]]:
    start, end = span(node)
    value = node.value
    if isinstance(value, bool):
        yield "constant", start, end, str(not value)
    elif isinstance(value, int) and text[start:end].lower().startswith(("0x", "0b")):
        for new in (value >> 1, value * 2 + 1):
            yield "mask", start, end, hex(new)
    elif isinstance(value, int | float):
        for other in {value + 1, value * 2, type(value)(0)} - {value}:
            yield "constant", start, end, repr(other)


def _between(kind: str, text: str, start: int, end: int, old: str, others: tuple[str, ...]):
    """The operator's own characters between two operands; comments there are not looked at."""
    pattern = r"\s+".join(map(re.escape, old.split()))
    match = re.search(rf"(?<!\w){pattern}(?!\w)" if old[0].isalpha() else pattern, text[start:end])
    if match is not None:
        for new in others:
            yield kind, start + match.start(), start + match.end(), new
