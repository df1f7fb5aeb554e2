"""XML as a tree with line numbers, read without ever expanding an entity: no bombs, no files from elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from core.errors import LabelError

MAX_DEPTH = 64


@dataclass(slots=True)
class XmlNode:
    """One element of an XML file."""

    tag: str
    attributes: dict[str, str]
    line: int
    text: str = ""
    children: list[XmlNode] = field(default_factory=list)

    def child(self, tag: str) -> XmlNode | None:
        """The first child of this name."""
        return next((child for child in self.children if child.tag == tag), None)

    def all(self, tag: str) -> Iterator[XmlNode]:
        """The children of this name."""
        return (child for child in self.children if child.tag == tag)

    def value(self, tag: str) -> str:
        """The text of a child.

        Raises:
            LabelError: if there is none.
        """
        child = self.child(tag)
        if child is None:
            raise LabelError(f"<{self.tag}> has no <{tag}>")
        return child.text.strip()

    def attribute(self, name: str) -> str:
        """The value of an attribute.

        Raises:
            LabelError: if it is missing.
        """
        if name not in self.attributes:
            raise LabelError(f"<{self.tag}> has no {name}")
        return self.attributes[name]


class XmlError(LabelError):
    """Text that is not XML of the kind we read."""

    def __init__(self, what: str, line: int) -> None:
        super().__init__(what)
        self.line = line


def parse_xml(text: str) -> XmlNode:
    """Parse a text and give its root element.

    Raises:
        XmlError: if the text is not well-formed, declares a document type or entities, or is nested too deeply.
    """
    parser = expat.ParserCreate("utf-8")  # the text is decoded already, whatever its declaration says
    parser.buffer_text = True
    stack: list[XmlNode] = []
    roots: list[XmlNode] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) >= MAX_DEPTH:
            raise XmlError("nested too deeply", parser.CurrentLineNumber)
        node = XmlNode(tag, attributes, parser.CurrentLineNumber)
        (stack[-1].children if stack else roots).append(node)
        stack.append(node)

    def refuse(*_: object) -> None:
        raise XmlError("document types and entities are not read", parser.CurrentLineNumber)

    def gather(text: str) -> None:
        if stack:
            stack[-1].text += text

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.CharacterDataHandler = gather
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(text.encode("utf-8", "surrogatepass"), True)
    except expat.ExpatError as error:
        raise XmlError(f"not XML: {expat.errors.messages[error.code]}", error.lineno) from error
    return roots[0]
