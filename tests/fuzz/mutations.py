"""Damage to files: bytes by a seeded generator, and tokens, lines and JSON values by strategies of hypothesis."""

from __future__ import annotations

import copy
import json
import random
import re
from collections.abc import Callable
from typing import Any

from hypothesis import strategies as st

NUMBERS = (
    "nan", "inf", "-inf", "9e59", "-9e59", "1e17", "1e308", "-1e308", "1e999", "1e-320", "-1", "0", "-0.0", "2147483648", "9007199254740993",
    "9223372036854775807", "9223372036854775808", "18446744073709551616", "1099511627776", "1" + "0" * 400, "9" * 5000, "1_0", "0x10", "١", "1.5",
    "1e3", "--1", "1e",
)  # fmt: skip
WORDS = (
    "", "oops", "null", "true", "\x00", "é", "\ud7ff", "../../x", "/etc/passwd", '"', "'", "<", "&", "&amp;", "%", "%d", "\x0b", "\u2028",
    "a" * 70000,
)  # fmt: skip
TOKENS = NUMBERS + WORDS
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 0.5, 1e308, -1e308, 9e59, -9e59, 1e-300, 2**31, 2**40, 2**53 + 1, 2**63, 2**64, 10**30, "", "oops", "a\x00b",
    "../x", "1", "inf", "é" * 300, [], {}, [[]], [None], [1], [1, 2, 3], [[1, 2], [3]], {"a": 1}, {"": None}, [[[[[[1]]]]]],
)  # fmt: skip
_TOKEN = re.compile(r"[^\s,=\"'<>:\[\]{}]+")


def _flip(data: bytearray, rng: random.Random) -> bytes:
    for _ in range(rng.choice((1, 1, 2, 8))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data)


def _replace(data: bytearray, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    data[at : at + rng.choice((0, 1, 4))] = rng.choice((b"\x00", b"\xff", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", rng.randbytes(4)))
    return bytes(data)


def _cut(data: bytearray, rng: random.Random) -> bytes:
    return bytes(data[: rng.randrange(len(data))])


def _drop(data: bytearray, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    del data[at : at + rng.choice((1, 7, 100, 5000))]
    return bytes(data)


def _double(data: bytearray, rng: random.Random) -> bytes:
    lines = bytes(data).splitlines(keepends=True)
    at = rng.randrange(len(lines))
    return b"".join(lines[: at + 1] + lines[at : at + rng.choice((1, 1, 3))] + lines[at + 1 :])


def _swap(data: bytearray, rng: random.Random) -> bytes:
    lines = bytes(data).splitlines(keepends=True)
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[a], lines[b] = lines[b], lines[a]
    return b"".join(lines)


def _number(data: bytearray, rng: random.Random) -> bytes:
    found = list(re.finditer(rb"-?\d[\d.eE+-]*", bytes(data)))
    if not found:
        return _replace(data, rng)
    at = rng.choice(found)
    return bytes(data[: at.start()]) + rng.choice(NUMBERS).encode() + bytes(data[at.end() :])


def _nest(data: bytearray, rng: random.Random) -> bytes:
    at, many = rng.randrange(len(data) + 1), rng.choice((40, 500, 900, 100_000))
    opening = rng.choice((b"[", b'{"a":', b"<a>", b"(", b'"'))
    return bytes(data[:at]) + opening * many + bytes(data[at:])


def _encode(data: bytearray, rng: random.Random) -> bytes:
    text = bytes(data).decode("latin-1")
    kind = rng.randrange(6)
    if kind == 0:
        return text.encode("utf-16")
    if kind == 1:
        return text.encode("utf-32")
    if kind == 2:
        return b"\xef\xbb\xbf" + bytes(data)
    at = rng.randrange(len(data) + 1)
    return bytes(data[:at]) + (b"\xe9", b"\xc3", b"\xed\xa0\x80")[kind - 3] + bytes(data[at:])


def _ends(data: bytearray, rng: random.Random) -> bytes:
    end = rng.choice((b"\r\n", b"\r", b"\n\n", b" \n", b"\t\n", b"\x0b\n", b"\x00\n"))
    return bytes(data).replace(b"\n", end) + rng.choice((b"", b"\n\n", b"  \n", b"\x1a"))


def _whole(data: bytearray, rng: random.Random) -> bytes:
    return rng.choice((b"", b"\n", b"\xef\xbb\xbf", b"\x00" * 4096, bytes(data) * 2, rng.randbytes(300), b"[]", b"{}", b"null", b"1"))


DAMAGE: tuple[Callable[[bytearray, random.Random], bytes], ...] = (
    _flip, _flip, _replace, _cut, _drop, _double, _swap, _number, _number, _number, _nest, _encode, _ends, _whole,
)  # fmt: skip


def damaged(sample: bytes, rng: random.Random) -> bytes:
    """The bytes of a valid file after one kind of damage, or two."""
    out = sample
    for _ in range(rng.choice((1, 1, 1, 2))):
        out = rng.choice(DAMAGE)(bytearray(out or b"\n"), rng)
    return out


def edits(sample: bytes) -> st.SearchStrategy[bytes]:
    """Files of the form of a sample: tokens and lines exchanged, and JSON values where the sample is JSON. A binary file has no such form."""
    try:
        text = sample.decode("utf-8")
    except UnicodeDecodeError:
        return st.nothing()
    ways = [st.lists(_token_edits(), min_size=1, max_size=3).map(lambda changes: _with_tokens(text, changes)), _line_edits(text)]
    try:
        value = json.loads(text)
    except ValueError:
        return st.one_of(*ways)
    places = list(_places(value))
    changes = st.lists(st.tuples(st.sampled_from(places), st.sampled_from((*VALUES, _REMOVE))), min_size=1, max_size=2)
    return st.one_of(*ways, changes.map(lambda listed: _with_values(value, listed)), changes.map(lambda listed: _with_values(value, listed)))


def _token_edits() -> st.SearchStrategy[tuple[float, str]]:
    return st.tuples(
        st.floats(0, 1, exclude_max=True), st.one_of(st.sampled_from(TOKENS), st.floats().map(repr), st.integers().map(str), st.text(max_size=3))
    )


def _with_tokens(text: str, changes: list[tuple[float, str]]) -> bytes:
    for share, token in changes:
        found = list(_TOKEN.finditer(text))
        if found:
            at = found[int(share * len(found))]
            text = text[: at.start()] + token + text[at.end() :]
    return text.encode("utf-8", "surrogatepass")


def _line_edits(text: str) -> st.SearchStrategy[bytes]:
    lines = text.split("\n")
    return st.lists(st.sampled_from(range(len(lines))), max_size=min(len(lines) + 3, 60)).map(lambda rows: "\n".join(lines[k] for k in rows).encode())


_REMOVE = object()
Place = tuple[str | int, ...]


def _places(value: Any, here: Place = ()) -> list[Place]:
    out = [here]
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in entries:
        out += _places(entry, (*here, key))
    return out


def _with_values(value: Any, changes: list[tuple[Place, Any]]) -> bytes:
    top = [json.loads(json.dumps(value))]
    for place, new in changes:
        at: Any = top
        *path, last = (0, *place)
        try:
            for key in path:
                at = at[key]
            if new is _REMOVE:
                del at[last]
            else:
                at[last] = copy.deepcopy(new)  # one value may be put into itself
        except (KeyError, IndexError, TypeError):
            continue  # the first change took away what the second one names
    return json.dumps(top[0] if top else None).encode()
