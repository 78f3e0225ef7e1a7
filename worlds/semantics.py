"""Semantic classes of geoms, derived from their names.

The name of a geom is its kind, then a number, then a suffix that distinguishes its parts: `tree3`, `wall0-left`, `frame1-lintel`.
"""

from __future__ import annotations

import re

CLASSES = ("sky", "ground", "wall", "structure", "furniture", "rock", "vegetation", "pole", "person", "robot")
"""Class numbers are indices into this list; 0 is for pixels without a geom."""

KINDS = {
    "ground": "ground",
    "wall": "wall",
    "partition": "wall",
    "beam": "structure",
    "frame": "structure",
    "pillar": "structure",
    "shelf": "furniture",
    "cabinet": "furniture",
    "table": "furniture",
    "chair": "furniture",
    "crates": "furniture",
    "barrel": "furniture",
    "bench": "furniture",
    "car": "structure",
    "pole": "pole",
    "tree": "vegetation",
    "hedge": "vegetation",
    "deck": "structure",
    "lamp": "structure",
    "arch": "structure",
    "column": "structure",
    "vault": "rock",
    "ledge": "rock",
    "rock": "rock",
    "bush": "vegetation",
    "stump": "vegetation",
    "log": "vegetation",
    "cone": "furniture",
    "bollard": "pole",
    "barrier": "furniture",
    "sign": "pole",
    "coat_stand": "furniture",
    "bin": "furniture",
    "tripod": "furniture",
    "heap": "furniture",
    "pram": "furniture",
    "poster": "furniture",
    "figure": "furniture",
    "umbrella": "furniture",
}
"""Kind of object → class. A new kind of geom needs an entry here."""


WORDS = {
    "ground": "ground floor terrain grass road street asphalt pavement sidewalk carpet soil lawn parquet stair stairs step steps ramp path plane",
    "wall": "wall facade partition brick window windows door curtain",
    "beam": "beam structure building house roof ceiling column arch frame car vehicle truck bus bridge pillar",
    "table": "table chair furniture desk sofa couch bed shelf cabinet bench bin box crate barrel cupboard bin bins pot mug mat",
    "rock": "rock stone boulder cliff cave",
    "tree": "tree bush hedge plant vegetation leaf leaves trunk foliage log",
    "pole": "pole lamp sign bollard post pegs peg leg legs",
}
"""Kind of object → words for it in the names of a user's nodes and materials."""
_KIND_OF_WORD = {word: kind for kind, words in WORDS.items() for word in words.split()}


def kind_of(names: str) -> str | None:
    """The kind, of KINDS, by the last known word in names of nodes, geoms and materials; None without a known word."""
    words = re.findall(r"[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", names).lower())
    found = [_KIND_OF_WORD[word] for word in words if word in _KIND_OF_WORD]
    return found[-1] if found else None


def class_of(geom: str) -> int:
    """The class number of a world's geom of that name. Raises ValueError for a kind that is not in KINDS."""
    kind = re.match(r"[a-z_]*", geom)
    assert kind is not None
    if kind.group() not in KINDS:
        raise ValueError(f"geom {geom!r} is of the kind {kind.group()!r}, needs one of {', '.join(KINDS)}")
    return CLASSES.index(KINDS[kind.group()])
