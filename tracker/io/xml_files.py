"""XML files of unknown origin, read into elements with line numbers. Document types and entities are refused."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax import SAXParseException
from xml.sax.handler import ContentHandler
from xml.sax.xmlreader import AttributesImpl

from defusedxml.common import DefusedXmlException
from defusedxml.expatreader import DefusedExpatParser

from tracker.io.text_files import parse_number

MAX_BYTES = 64 * 2**20
MAX_DEPTH = 32
LARGEST_INTEGER = 2**53
"""Whole numbers from this one on are not exact as floats."""


@dataclass
class Element:
    """One XML element: its tag, attributes, children, the line where it begins, the path of its file, and the text between its tags.

    All methods raise ValueError with file, line and field for what is missing or malformed.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    where: str
    children: list[Element] = field(default_factory=list)
    content: str = ""

    def find(self, tag: str) -> Element:
        """The first child with this tag."""
        for child in self.children:
            if child.tag == tag:
                return child
        raise ValueError(f"{self.where}:line {self.line}: field {tag} is missing in {self.tag}")

    def find_all(self, tag: str) -> list[Element]:
        """All children with this tag; may be empty."""
        return [child for child in self.children if child.tag == tag]

    def text(self, *names: str) -> str:
        """The first attribute present among `names`, which are alternative spellings."""
        for name in names:
            if name in self.attributes:
                return self.attributes[name]
        raise ValueError(f"{self.where}:line {self.line}: field {self.tag}.{names[0]} is missing")

    def number(self, *names: str) -> float:
        """As `text`, as a finite number."""
        return parse_number(self.text(*names), f"{self.where}:line {self.line}: field {self.tag}.{names[0]}")

    def integer(self, name: str) -> int:
        """An attribute as a whole number below LARGEST_INTEGER."""
        value = self.number(name)
        if value != round(value) or abs(value) >= LARGEST_INTEGER:
            raise ValueError(f"{self.where}:line {self.line}: field {self.tag}.{name} is {value}, needs a whole number below 2^53")
        return int(value)


class _Tree(ContentHandler):
    """Builds the tree of elements below `top`."""

    def __init__(self, where: str, parser: DefusedExpatParser) -> None:
        super().__init__()
        self.top = Element("", {}, 1, where)
        self._open = [self.top]
        self._texts: list[list[str]] = [[]]
        self._parser = parser

    def startElement(self, name: str, attrs: AttributesImpl) -> None:
        element = Element(name, dict(attrs.items()), self._parser.getLineNumber() or 0, self.top.where)
        if len(self._open) > MAX_DEPTH:
            raise ValueError(f"{element.where}:line {element.line}: field {name} is nested deeper than {MAX_DEPTH}")
        self._open[-1].children.append(element)
        self._open.append(element)
        self._texts.append([])

    def characters(self, content: str) -> None:
        self._texts[-1].append(content)

    def endElement(self, name: str) -> None:
        self._open.pop().content = "".join(self._texts.pop())


def parse(path: str | os.PathLike[str], root: str) -> Element:
    """The top element of an XML file; its tag must be `root`.

    Raises ValueError with the path for content that is no XML, files above MAX_BYTES, and elements nested deeper than MAX_DEPTH.
    Document types and entities are refused, because they can name other files and grow without bound.
    """
    source = Path(path)
    if source.stat().st_size > MAX_BYTES:
        raise ValueError(f"{path}: {source.stat().st_size} bytes, needs at most {MAX_BYTES}")
    parser = DefusedExpatParser(forbid_dtd=True)
    tree = _Tree(str(path), parser)
    parser.setContentHandler(tree)
    try:
        with source.open("rb") as file:
            parser.parse(file)
    except DefusedXmlException:
        raise ValueError(f"{path}:line {parser.getLineNumber()}: holds a document type or an entity, which is refused") from None
    except SAXParseException as error:
        raise ValueError(f"{path}: is not XML: {error.getMessage()}: line {error.getLineNumber()}, column {error.getColumnNumber()}") from None
    except (LookupError, UnicodeError) as error:
        raise ValueError(f"{path}: is not XML: {error}") from None
    return tree.top.find(root)
