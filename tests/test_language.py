"""The language of the project: short sentences in docstrings, the field's words in names."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
HOUSES = ("worlds", "tracker", "sim")
MOST_WORDS = 25
RETIRED = (
    "bonds", "looks", "fashion", "doubt", "troubles", "contender", "ladder", "spectacle", "spectator", "likeness", "footing", "wayfinder",
    "newcomers", "astray", "expedition", "outing", "hope", "learners", "errand", "lookouts", "workforce", "gallery", "soles", "strides",
    "regrets", "worthwhile", "dressed", "strangers", "reunion", "vague", "outlook", "candidates", "frontier", "companions",
)  # fmt: skip
"""Words of a private language that the field's terms have replaced, as names of files."""


def sentences(text: str) -> Iterator[str]:
    """Sentences of prose: ended by a period, a question mark, a blank line, or the start of a list item.

    Quoted code, formulas in backquotes and indented examples count as one word or are left out.
    """
    text = re.sub(r"`[^`]*`", "CODE", text)
    for paragraph in re.split(r"\n\s*\n|\n\s*(?=[*-] )", text):
        if re.match(r"\s*(Example|Examples)\b", paragraph):
            continue
        flat = " ".join(paragraph.split())
        yield from (part for part in re.split(r"(?<=[.!?])\s+", flat) if part)


def words(sentence: str) -> int:
    """Words with a letter in them; numbers, operators, and what stands in brackets (units, shapes, sources) do not count."""
    plain = re.sub(r"\([^()]*\)|\[[^\[\]]*\]", " ", sentence)
    return len([word for word in plain.split() if re.search(r"[^\W\d_]{2,}|\b[aAI]\b", word)])


def docstrings(path: Path) -> Iterator[tuple[int, str]]:
    """Docstrings of the module, its classes, functions and constants, each with its line."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        for child in getattr(node, "body", []) if isinstance(getattr(node, "body", None), list) else []:
            if isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant) and isinstance(child.value.value, str):
                yield child.lineno, child.value.value


@pytest.mark.parametrize("house", HOUSES)
def test_sentences_of_docstrings_are_short(house: str) -> None:
    long = [
        f"{path.relative_to(ROOT)}:{line}: {words(sentence)} words: {sentence}"
        for path in sorted((ROOT / house).rglob("*.py"))
        for line, text in docstrings(path)
        for sentence in sentences(text)
        if words(sentence) > MOST_WORDS
    ]
    assert not long, "\n".join(long)


@pytest.mark.parametrize("house", HOUSES)
def test_files_bear_the_words_of_the_field(house: str) -> None:
    for path in (ROOT / house).rglob("*.py"):
        assert path.stem not in RETIRED, path
