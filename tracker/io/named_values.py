"""Texts of options, as NAME=VALUE,NAME=VALUE."""

from __future__ import annotations

import difflib
from collections.abc import Collection


def named_values(text: str, known: Collection[str], subject: str, needed: str) -> dict[str, str]:
    """Name → the text of its value. A dash in a name counts as an underscore where such a name is known.

    subject: what the text is of, and needed: what an item has to be, for the message.
    Raises ValueError for an unknown name, with the nearest one, and for a name that occurs twice.
    """
    found: dict[str, str] = {}
    for item in filter(None, (part.strip() for part in text.split(","))):
        name, equals, value = (part.strip() for part in item.partition("="))
        name = name if name in known else name.replace("-", "_")
        if not equals or name not in known:
            near = difflib.get_close_matches(name, known, 1, 0.6)
            hint = f" ({near[0]}?)" if near and name not in known else ""
            raise ValueError(f"{subject} {item[:60]!r}{hint}, needs {needed}")
        if name in found:
            raise ValueError(f"{subject} {name} twice")
        found[name] = value
    return found
