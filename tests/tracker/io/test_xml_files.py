"""XML of unknown origin: line numbers, limits, and refusals."""

from pathlib import Path

import pytest

from tracker.io.xml_files import MAX_DEPTH, parse


def written(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "a.xml"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_elements_have_line_numbers_in_any_encoding(tmp_path: Path, encoding: str) -> None:
    path = written(tmp_path, "<a>\n<!-- a\ncomment -->\n<b x='é'/><b\nx='2'/>\n</a>", encoding)
    top = parse(path, "a")
    assert [(child.tag, child.attributes, child.line) for child in top.children] == [("b", {"x": "é"}, 4), ("b", {"x": "2"}, 4)]
    with pytest.raises(ValueError, match=r"a.xml:line 4: field b.x is 'é', needs a number"):
        top.find("b").number("x")


def test_line_numbers_in_a_large_file(tmp_path: Path) -> None:
    top = parse(written(tmp_path, "<a>\n" + "<b x='1'/>\n" * 50_000 + "</a>"), "a")
    assert [child.line for child in top.find_all("b")] == list(range(2, 50_002))


def test_depth_limit(tmp_path: Path) -> None:
    for deep in (MAX_DEPTH, MAX_DEPTH + 1):
        path = written(tmp_path, "<a>\n" * deep + "</a>" * deep)
        if deep == MAX_DEPTH:
            parse(path, "a")
        else:
            with pytest.raises(ValueError, match=rf"a.xml:line {deep}: field a is nested deeper than {MAX_DEPTH}"):
                parse(path, "a")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<a>\n<b>\n</a>", "is not XML: mismatched tag: line 3, column 2"),
        ("<a/>\n<a/>", "is not XML: junk after document element: line 2, column 0"),
        ("<a>&b;</a>", "is not XML: undefined entity: line 1, column 3"),
        ("<?xml version='1.0'?>\n<!DOCTYPE a>\n<a/>", "line 2: holds a document type or an entity, which is refused"),
        ("\n<!DOCTYPE a SYSTEM 'http://example.org/a.dtd'><a/>", "line 2: holds a document type or an entity, which is refused"),
        ("\n\n<!DOCTYPE a [<!ENTITY % b SYSTEM 'b.xml'> %b;]><a/>", "line 3: holds a document type or an entity, which is refused"),
    ],
)
def test_refusals_name_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ValueError, match=r"is not XML|refused") as error:
        parse(path, "a")
    assert str(error.value) in (f"{path}: {message}", f"{path}:{message}")


def test_elements_have_the_text_between_their_tags(tmp_path: Path) -> None:
    top = parse(written(tmp_path, "<a>\n one <b>two<c>three</c> four</b>\n<d/>five</a>"), "a")
    assert top.content.split() == ["one", "five"]
    assert [(child.tag, child.content) for child in top.children] == [("b", "two four"), ("d", "")]
    assert top.find("b").find("c").content == "three"
