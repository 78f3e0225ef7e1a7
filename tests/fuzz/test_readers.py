"""Damaged files: each ends with a value or with a ValueError on one line that names the file, within 10 s and 1 GiB."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.fuzz.client import Client
from tests.fuzz.readers import READERS, Reader
from tests.fuzz.worker import WAYS

FAST, LONG = 8, 40
"""Inputs of a reader and way: of tests marked `command`, and of `soak`."""
FIRST_SEED, SECOND_SEED = 1, 2
TEXTS = [name for name, reader in READERS.items() if reader.form != "binary"]
RAISING = [name for name in TEXTS if not name.startswith("validation")]
"""A validation gives the faults as values."""
TABLES = [name for name, reader in READERS.items() if reader.form == "lines"]


@pytest.fixture(scope="module")
def worker() -> Iterator[Client]:
    with Client() as client:
        yield client


def check(worker: Client, name: str, count: int, seed: int, limit: float, record: Callable[[str, object], None]) -> None:
    faults: dict[str, Any] = {}
    inputs = 0
    for way in WAYS:
        answer = worker.ask({"reader": name, "way": way, "count": count, "seed": seed}, limit)
        assert "error" not in answer, answer["error"]
        inputs += answer["inputs"]
        faults |= answer["faults"]
    record("inputs", inputs)
    said = "\n".join(f"{where} ({fault['count']} x): {fault['message']}\n    {fault['input']}" for where, fault in faults.items())
    assert not faults, f"{name}: {len(faults)} faults in {inputs} inputs\n{said}"


@pytest.mark.command
@pytest.mark.parametrize("name", READERS)
def test_damaged_files_are_read_or_refused(worker: Client, name: str, record_property: Callable[[str, object], None]) -> None:
    check(worker, name, FAST, FIRST_SEED, 120.0, record_property)


@pytest.mark.soak
@pytest.mark.parametrize("name", READERS)
def test_many_damaged_files_are_read_or_refused(worker: Client, name: str, record_property: Callable[[str, object], None]) -> None:
    check(worker, name, LONG, SECOND_SEED, 600.0, record_property)


def test_every_reader_is_in_the_table() -> None:
    """Functions of the packages of formats that read a file are called by some reader of the table."""
    root = Path(__file__).parents[2]
    known = Path(__file__).with_name("readers.py").read_text(encoding="utf-8")
    files = [path for package in ("formats", "planar_slam") for path in sorted((root / "tracker" / package).rglob("*.py"))]
    # What opens a source calls these readers; the table has the folders of all sources.
    opened = "".join(path.read_text(encoding="utf-8") for path in files if path.name in ("reading.py", "opening.py", "pets2009.py"))
    for path in files:
        for name in re.findall(r"^def (read_\w+)\(", path.read_text(encoding="utf-8"), re.MULTILINE):
            assert re.search(rf"\b{name}\b", known + opened), f"{path.name}: {name} is in no line of READERS"


def sample(reader: Reader, folder: Path) -> Path:
    reader.make(folder)
    return folder / reader.file


REPRESENTATIVES = (
    "MOT15 truth", "sequence odometry.csv", "sequence calibration.json", "CVML", "DIMACS", "UTIAS Robot1_Odometry", "AI City results",
    "stress report", "settings TOML",
)  # fmt: skip
"""One reader of each way of reading text: rows, tables, JSON, XML, blanks between numbers, JSON lines, TOML."""
CHANGES: dict[str, Callable[[bytes], bytes]] = {
    "byte order mark": lambda data: b"\xef\xbb\xbf" + data,
    "CR LF": lambda data: data.replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"),
    "lone CR": lambda data: data.replace(b"\r\n", b"\n").replace(b"\n", b"\r"),
    "trailing blanks": lambda data: data.replace(b"\r\n", b"\n").replace(b"\n", b" \t\n"),
    "blank lines at the end": lambda data: data + b"\n\n  \n",
}
"""Changes by editors and other systems that do not change the content."""


def _is_text(name: str, change: str) -> bool:
    """Whether a file stays valid. TOML 1.0 has no line end CR, and the last row of results.jsonl is whole where LF ends it."""
    return change != "lone CR" or not READERS[name].file.endswith((".toml", ".jsonl"))


def _changed() -> Iterator[tuple[str, str]]:
    """All changes of the readers that stand for one way of reading each, and one change of every other."""
    for number, name in enumerate(TEXTS):
        valid = [change for change in CHANGES if _is_text(name, change)]
        yield from ((name, change) for change in (valid if name in REPRESENTATIVES else [valid[number % len(valid)]]))


@pytest.mark.parametrize(("name", "change"), _changed())
def test_marks_line_ends_and_blanks_do_not_matter(tmp_path: Path, name: str, change: str) -> None:
    reader = READERS[name]
    file = sample(reader, tmp_path)
    file.write_bytes(CHANGES[change](file.read_bytes()))
    if reader.sums:
        with pytest.raises(ValueError, match=r"SHA-256|bytes, the manifest says"):
            reader.read(tmp_path)
        return
    reader.read(tmp_path)


@pytest.mark.parametrize("name", RAISING)
def test_other_encodings_are_refused_with_their_place(tmp_path: Path, name: str) -> None:
    """Latin-1 has bytes that are no UTF-8. XML may name its encoding, and comments of DIMACS are never read."""
    reader = READERS[name]
    file = sample(reader, tmp_path)
    data = file.read_bytes()
    middle = data.index(b"\n", len(data) // 2) if b"\n" in data[len(data) // 2 :] else len(data) // 2
    file.write_bytes(data[:middle] + b"\xe9" + data[middle:])
    with pytest.raises(ValueError, match=re.escape(str(tmp_path))) as error:
        reader.read(tmp_path)
    assert re.search(r":\d+|line \d+|byte \d+|SHA-256|bytes", str(error.value)), str(error.value)


@pytest.mark.parametrize("name", TABLES)
def test_a_word_for_a_number_is_named_by_its_line(tmp_path: Path, name: str) -> None:
    reader = READERS[name]
    file = sample(reader, tmp_path)
    lines = file.read_text(encoding="utf-8").splitlines()
    number = next(k for k in range(len(lines) - 1, -1, -1) if lines[k].strip())
    found = list(re.finditer(r"-?\d+(\.\d+)?(e-?\d+)?", lines[number]))[-1]
    lines[number] = f"{lines[number][: found.start()]}oops{lines[number][found.end() :]}"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(file.name)) as error:
        reader.read(tmp_path)
    if not reader.sums:
        assert re.search(rf":(line )?{number + 1}\b|line {number + 1}\b", str(error.value)), str(error.value)


@pytest.mark.parametrize("name", ["DIMACS", "UTIAS Robot1_Odometry", "UTIAS Barcodes"])
def test_tabs_separate_like_blanks(tmp_path: Path, name: str) -> None:
    reader = READERS[name]
    file = sample(reader, tmp_path)
    file.write_bytes(file.read_bytes().replace(b" ", b"\t"))
    reader.read(tmp_path)


def test_only_line_ends_count_as_lines(tmp_path: Path) -> None:
    """Other programs do not end a line at U+2028, at a vertical tab or at a form feed, which splitlines does."""
    reader = READERS["MOT15 truth"]
    file = sample(reader, tmp_path)
    lines = file.read_text(encoding="utf-8").splitlines()
    file.write_text("\n".join([lines[0] + "\u2028", lines[1] + "\x0b", lines[2] + "\x0c", "oops", *lines[3:]]) + "\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"gt.txt:4: 1 values"):
        reader.read(tmp_path)
