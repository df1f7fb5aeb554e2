"""JSON and XML whose objects and elements know the line they stand on, so that a rejection can name it.

XML is read by defusedxml: no entities, no document types.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.sax import SAXException, SAXParseException
from xml.sax.handler import ContentHandler
from xml.sax.xmlreader import AttributesImpl, InputSource, Locator

from defusedxml import DefusedXmlException
from defusedxml.sax import make_parser

from core.errors import LabelError
from labels.formats.exchange import DocumentError

MAX_DEPTH = 64
_TOKENS = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\n]', re.DOTALL)


class JsonObject(dict[str, object]):
    """A JSON object; `line` is where it begins, `repeated` how many of its keys stand there again."""

    line: int = 1
    repeated: int = 0


def parse_json(text: str) -> object:
    """The value, with objects as `JsonObject`.

    Raises:
        DocumentError: if the text is not JSON.
    """
    lines = _lines_of_objects(text)

    def make(pairs: list[tuple[str, object]]) -> JsonObject:
        made = JsonObject(pairs)
        made.line, made.repeated = next(lines, 1), len(pairs) - len(made)
        return made

    try:
        return json.loads(text, object_pairs_hook=make)
    except json.JSONDecodeError as error:
        raise DocumentError(f"not JSON: {error.msg}", error.lineno) from error
    except (RecursionError, ValueError) as error:
        raise DocumentError(f"not JSON that can be read: {error}", 1) from error


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


class _Tree(ContentHandler):
    """Builds the nodes."""

    def __init__(self) -> None:
        super().__init__()
        self.root: XmlNode | None = None
        self._stack: list[XmlNode] = []
        self._locator: Locator | None = None

    def setDocumentLocator(self, locator: Locator) -> None:  # noqa: N802 (the interface of SAX)
        self._locator = locator

    @property
    def line(self) -> int:
        """Where the parser is."""
        return 1 if self._locator is None else self._locator.getLineNumber() or 1

    def startElement(self, name: str, attrs: AttributesImpl) -> None:  # noqa: N802
        if len(self._stack) >= MAX_DEPTH:
            raise DocumentError("nested too deeply", self.line)
        node = XmlNode(name, dict(attrs.items()), self.line)
        if self._stack:
            self._stack[-1].children.append(node)
        else:
            self.root = node
        self._stack.append(node)

    def endElement(self, name: str) -> None:  # noqa: N802
        self._stack.pop()

    def characters(self, content: str) -> None:
        if self._stack:
            self._stack[-1].text += content


def parse_xml(text: str) -> XmlNode:
    """Parse a text and give its root element.

    Raises:
        DocumentError: if the text is not well-formed, declares a document type or entities, or is nested too deeply.
    """
    tree = _Tree()
    parser = make_parser()
    parser.forbid_dtd = True
    parser.setContentHandler(tree)
    source = InputSource()
    source.setByteStream(io.BytesIO(text.encode("utf-8", "surrogatepass")))
    source.setEncoding("utf-8")  # the text is decoded already, whatever its declaration says
    try:
        parser.parse(source)
    except DefusedXmlException as error:
        raise DocumentError("document types and entities are not read", tree.line) from error
    except SAXParseException as error:
        raise DocumentError(f"not XML: {error.getMessage()}", error.getLineNumber() or tree.line) from error
    except SAXException as error:
        raise DocumentError(f"not XML: {error}", tree.line) from error
    if tree.root is None:
        raise DocumentError("not XML: no element found", 1)
    return tree.root
