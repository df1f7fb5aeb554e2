"""XML as a tree of elements that know their lines, read by defusedxml: no entities, no document types."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.sax import SAXException, SAXParseException
from xml.sax.handler import ContentHandler
from xml.sax.xmlreader import AttributesImpl, InputSource, Locator

from defusedxml import DefusedXmlException
from defusedxml.sax import make_parser

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
            raise XmlError("nested too deeply", self.line)
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
        XmlError: if the text is not well-formed, declares a document type or entities, or is nested too deeply.
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
        raise XmlError("document types and entities are not read", tree.line) from error
    except SAXParseException as error:
        raise XmlError(f"not XML: {error.getMessage()}", error.getLineNumber() or tree.line) from error
    except SAXException as error:
        raise XmlError(f"not XML: {error}", tree.line) from error
    if tree.root is None:
        raise XmlError("not XML: no element found", 1)
    return tree.root
