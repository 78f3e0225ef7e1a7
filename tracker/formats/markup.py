"""XML that may come from anywhere: read with the line of every fault; what could name other files or grow without bound is refused."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

import numpy as np

MAX_BYTES = 64 * 2**20
MAX_DEPTH = 32


@dataclass
class Element:
    """One element of a file, with the line that it began on."""

    tag: str
    attributes: dict[str, str]
    line: int
    where: str
    children: list[Element] = field(default_factory=list)

    def find(self, tag: str) -> Element:
        for child in self.children:
            if child.tag == tag:
                return child
        raise ValueError(f"{self.where}:line {self.line}: field {tag} is missing in {self.tag}")

    def every(self, tag: str) -> list[Element]:
        return [child for child in self.children if child.tag == tag]

    def text(self, *names: str) -> str:
        """The attribute of the first of `names` (spellings of one thing) that is there."""
        for name in names:
            if name in self.attributes:
                return self.attributes[name]
        raise ValueError(f"{self.where}:line {self.line}: field {self.tag}.{names[0]} is missing")

    def number(self, *names: str) -> float:
        text = self.text(*names)
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise ValueError(f"{self.where}:line {self.line}: field {self.tag}.{names[0]} is {text!r}, needs a finite number")
        return value

    def whole(self, name: str) -> int:
        value = self.number(name)
        if value != round(value):
            raise ValueError(f"{self.where}:line {self.line}: field {self.tag}.{name} is {value}, needs a whole number")
        return int(value)


def parse(path: str | os.PathLike[str], root: str) -> Element:
    """The file's tree. A document type or an entity is refused (they can name other files and grow without bound), and so are
    files above 64 MiB and elements nested deeper than 32.
    """
    source = Path(path)
    if source.stat().st_size > MAX_BYTES:
        raise ValueError(f"{path}: {source.stat().st_size} bytes, needs at most {MAX_BYTES}")
    top = Element("", {}, 1, str(path))
    stack = [top]
    parser = expat.ParserCreate()

    def refuse(*_: object) -> NoReturn:
        raise ValueError(f"{path}:line {parser.CurrentLineNumber}: holds a document type or an entity, which is refused")

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, parser.CurrentLineNumber, str(path))
        if len(stack) > MAX_DEPTH:
            raise ValueError(f"{path}:line {element.line}: field {tag} is nested deeper than {MAX_DEPTH}")
        stack[-1].children.append(element)
        stack.append(element)

    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    try:
        parser.Parse(source.read_bytes(), True)
    except (expat.ExpatError, LookupError, UnicodeError) as error:
        raise ValueError(f"{path}: is not XML: {error}") from None
    return top.find(root)
