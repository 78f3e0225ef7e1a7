"""Semantic classes of geoms, derived from their names.

Every geom of a world is named after its kind, then a number, then whatever tells its parts apart: `tree3`, `wall0-left`, `frame1-lintel`.
"""

from __future__ import annotations

import re

CLASSES = ("sky", "ground", "wall", "structure", "furniture", "rock", "vegetation", "pole", "person", "robot")
"""Class numbers are places in this list; 0 is where nothing is."""

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
"""Kind of thing → class. A new kind is named here."""


WORDS = {
    "ground": "ground floor terrain grass road street asphalt pavement sidewalk carpet soil lawn parquet stair stairs step steps ramp path plane",
    "wall": "wall facade partition brick window windows door curtain",
    "beam": "beam structure building house roof ceiling column arch frame car vehicle truck bus bridge pillar",
    "table": "table chair furniture desk sofa couch bed shelf cabinet bench bin box crate barrel cupboard bin bins pot mug door_mat",
    "rock": "rock stone boulder cliff cave",
    "tree": "tree bush hedge plant vegetation leaf leaves trunk foliage log",
    "pole": "pole lamp sign bollard post pegs peg leg legs",
}
"""Kind of thing → words in the names of a user's nodes and materials that mean it."""
_KIND_OF_WORD = {word: kind for kind, words in WORDS.items() for word in words.split()}


def kind_of(names: str) -> str | None:
    """The kind that names of nodes, geoms and materials mean, of KINDS; None where they mean nothing known. The last known word counts."""
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
