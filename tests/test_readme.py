"""The READMEs hold: their commands and Python run, their options, links, anchors and paths exist, and their sentences are short."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import tyro

from sim.cli.main import COMMANDS, OLD_NAMES, command_of, today
from tests.benchmarks.__main__ import NAMES
from tests.commands import pilsim

ROOT = Path(__file__).parent.parent
FRONT = ROOT / "README.md"
LINES, COLUMNS, WORDS = 150, 110, 25
"""Most lines and columns of the front page; most words of a sentence of any page."""
HOUSES = ("sim", "tracker", "worlds")
OPERATORS = ("&&", "||", "|", ";", "&", ">", "<")


def _known_to_git() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "*README.md"], cwd=ROOT, capture_output=True, text=True, check=True)
    return [ROOT / name for name in listed.stdout.split()]


PAGES = _known_to_git()


@dataclass(frozen=True)
class Block:
    """A fenced block: language ("" of a plain one) and text, of a page of that name, beginning after that line."""

    page: str
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


@functools.cache
def _parts(page: Path) -> tuple[str, list[Block]]:
    """The text of a page without its fenced and indented blocks, line by line as it stands, and its fenced blocks."""
    prose: list[str] = []
    blocks: list[Block] = []
    fence: list[str] | None = None
    lines = page.read_text(encoding="utf-8").splitlines()
    for number, line in enumerate(lines, 1):
        if line.startswith("```"):
            if fence is None:
                fence, language, first = [], line[3:].strip(), number
            else:
                blocks.append(Block(str(page.relative_to(ROOT)), first, language, "\n".join(fence) + "\n"))
                fence = None
            prose.append("")
        elif fence is not None:
            fence.append(line)
            prose.append("")
        else:
            prose.append("" if line.startswith("    ") else line)
    assert fence is None, f"{page}: a fenced block does not end"
    return "\n".join(prose), blocks


def _prose(page: Path) -> str:
    return _parts(page)[0]


def _blocks(language: str) -> list[Block]:
    return [block for page in PAGES for block in _parts(page)[1] if block.language == language]


def _sets_up(block: Block) -> bool:
    """Whether a block installs or builds: what it names is checked, but it is not run."""
    return any(words[0] in ("make", "pip") for words in _commands(block.text))


def _commands(text: str) -> Iterator[list[str]]:
    """The simple commands of a shell block, in words, without comments, operators and assignments before a command."""
    for line in text.splitlines():
        words: list[str] = []
        lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
        lexer.whitespace_split = True
        for word in [*lexer, ";"]:
            if word not in OPERATORS:
                words.append(word)
            elif words:
                while words and re.fullmatch(r"[A-Z_]+=.*", words[0]):
                    del words[0]
                if words:
                    yield words
                words = []


def _spans(page: Path) -> list[str]:
    """What stands between single backticks in prose and tables."""
    return re.findall(r"`([^`]+)`", _prose(page))


RUN = [block for block in _blocks("sh") if not _sets_up(block)]
READ = [block for block in (*_blocks(""), *_blocks("sh")) if block not in RUN]


def test_there_is_something_to_test() -> None:
    assert FRONT in PAGES
    assert all(ROOT / house / "README.md" in PAGES for house in HOUSES)
    assert len(RUN) >= 5
    assert len(_blocks("python")) >= 3
    assert len(READ) >= 10


@pytest.mark.command
@pytest.mark.render
@pytest.mark.parametrize("block", RUN, ids=str)
def test_commands_run(block: Block, tmp_path: Path, data: Callable[..., Path]) -> None:
    """Blocks of `pilsim` alone run without a shell."""
    text = block.text.replace("$PETS", str(data("pets2009"))) if "$PETS" in block.text else block.text
    commands = list(_commands(text))
    if all(words[0] == "pilsim" for words in commands):
        runs = (pilsim(*words[1:], cwd=tmp_path) for words in commands)
    else:
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        bash = ["bash", "-euc", text]
        runs = iter([subprocess.run(bash, cwd=tmp_path, env=dict(os.environ, PATH=path), capture_output=True, text=True, check=False, timeout=300)])
    for done in runs:
        assert done.returncode == 0, done.stderr


@pytest.mark.command
@pytest.mark.render
@pytest.mark.parametrize("block", _blocks("python"), ids=str)
def test_python_runs(block: Block, tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", block.text], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip(), "prints nothing"


@pytest.mark.parametrize("block", [*READ, *RUN], ids=str)
def test_commands_are_known(block: Block) -> None:
    """Every command line is one that `pilsim`, `make` or `python -m` takes; values that name files are not looked for."""
    for words in _commands(block.text):
        if words[0] == "pilsim":
            _parsed(words[1:])
        else:
            _check_other(words)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_options_in_prose_are_known(page: Path) -> None:
    """In prose a command may lack what it needs; but its name and options exist."""
    for span in _spans(page):
        if not span.startswith(("pilsim ", "make ", "python -m ")):
            continue
        for words in _commands(span):
            if words[0] != "pilsim":
                _check_other(words)
            elif words[1] != "COMMAND" and not words[1].startswith("--"):
                assert words[1] in COMMANDS, f"{page}: {span}"
                unknown = {word for word in words[2:] if word.startswith("--")} - _flags(words[1])
                assert not unknown, f"{page}: {span}"


def _parsed(words: list[str]) -> None:
    """Parses the words after `pilsim` as the command line does, without running them."""
    errors = io.StringIO()
    try:
        with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(errors):
            tyro.cli(command_of(words[0]), prog="pilsim", args=today(words)[1:])
    except SystemExit:
        pytest.fail(f"pilsim {' '.join(words)}: {errors.getvalue()}")


@functools.cache
def _flags(command: str) -> set[str]:
    """All options that the help of a command names."""
    shown = io.StringIO()
    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(shown):
        tyro.cli(command_of(command), prog="pilsim", args=["--help"])
    return set(re.findall(r"--[a-z][a-z-]*", shown.getvalue())) | set(OLD_NAMES.get(command, ()))


def _check_other(words: list[str]) -> None:
    """`make TARGET` and `python -m MODULE` name what there is."""
    if words[0] == "make":
        targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
        assert {word for word in words[1:] if "=" not in word} <= set(targets), words
    elif words[:2] == ["python", "-m"]:
        assert importlib.util.find_spec(words[2]), words
        if words[2] == "tests.benchmarks":
            assert set(words[3:]) <= {*NAMES, "NAME", "..."}, words


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for picture, target in re.findall(r"(!?)\[[^\]]*\]\(([^)]+)\)", _prose(page)):
        if target.startswith(("http://", "https://")):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), f"{page}: {target}"
        if picture:
            assert file.stat().st_size > 10_000, f"{page}: {target}"
        if anchor:
            assert anchor in _anchors(file), f"{page}: {target}"


@functools.cache
def _anchors(page: Path) -> set[str]:
    """The names by which GitHub links to the headings of a page."""
    titles = re.findall(r"^#+ (.+)$", _prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_paths_exist(page: Path) -> None:
    """Modules named anywhere, and packages named in tables, lie beside the page or below the root."""
    tables = re.findall(r"`([^`]+)`", "\n".join(line for line in _prose(page).splitlines() if line.startswith("|")))
    modules = [span for span in _spans(page) if re.fullmatch(r"[a-z_0-9/]+\.py", span)]
    packages = [span for span in tables if re.fullmatch(r"[a-z_]+(/[a-z_]+)*/?", span) and "/" in span]
    for path in (*modules, *packages):
        assert (page.parent / path).exists() or (ROOT / path).exists(), f"{page}: {path}"


@pytest.mark.parametrize("house", HOUSES)
def test_the_map_of_a_house_is_whole(house: str) -> None:
    spans = {span.rstrip("/") for span in _spans(ROOT / house / "README.md")}
    packages = {folder.parent.name for folder in (ROOT / house).glob("*/__init__.py")}
    modules = {file.name for file in (ROOT / house).glob("*.py")} - {"__init__.py"}
    assert packages | modules <= spans, f"{house}/README.md lacks {sorted((packages | modules) - spans)}"


def test_the_front_page_is_short() -> None:
    lines = FRONT.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= LINES
    assert not [(number, len(line)) for number, line in enumerate(lines, 1) if len(line) > COLUMNS]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_sentences_are_short(page: Path) -> None:
    long = [sentence for sentence in sentences(_prose(page)) if _words(sentence) > WORDS]
    assert not long, "\n".join(f"{_words(sentence)} words: {sentence}" for sentence in long)


def sentences(text: str) -> list[str]:
    """The sentences of paragraphs and list items; headings, tables and pictures have none. Code is one word, and a link is its text."""
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"`[^`]*`", "CODE", text)
    out: list[str] = []
    for paragraph in re.split(r"\n\s*\n|\n(?=\s*(?:[*-]|\d+\.) )", "\n".join(line for line in text.splitlines() if not line.startswith(("|", "#")))):
        whole = re.sub(r"^(?:[*-]|\d+\.) ", "", " ".join(paragraph.split()))
        # A stop ends a sentence where a capital follows: not in "Fig. 4" or "et al., ...".
        out += [part for part in re.split(r"(?<=[.!?])[*)\"]* +(?=[*(\"]*[A-Z])", whole) if part]
    return out


def _words(sentence: str) -> int:
    return sum(bool(re.search(r"\w", word)) for word in sentence.split())


def test_sentences_are_told_apart() -> None:
    text = "# A title. No sentence\n\nOne `a. B` two. Three\nfour, Fig. 4 of Yoo et al., 2017.\n* Five [six. Seven](x.md)!\n* Eight\n\n| no | One |\n"
    assert sentences(text) == ["One CODE two.", "Three four, Fig. 4 of Yoo et al., 2017.", "Five six.", "Seven!", "Eight"]
    assert [_words(sentence) for sentence in sentences(text)] == [3, 9, 2, 1, 1]
