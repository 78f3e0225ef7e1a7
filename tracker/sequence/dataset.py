"""A dataset: a folder of Sequences made alike, and dataset.json, which says what they are and how many there shall be.

Only what carries a manifest is a sequence: one that is still written has another name.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tracker.io.json_files import read_json

SCHEMA = 1
"""Of dataset.json; every sequence has the schema of its own in its manifest."""
FILE, MANIFEST = "dataset.json", "manifest.json"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")


@dataclass(frozen=True)
class Dataset:
    """preset: what kind of sequences; scenario: that of the first as JSON values, the next have the next seeds; views: fixed cameras beside
    the robots; form: further options of what is written, as JSON values; sequences: names of their folders, in order.

    Raises ValueError for a name that is no plain name of a folder, or is there twice.
    """

    preset: str
    scenario: dict[str, Any]
    views: int
    form: dict[str, Any]
    sequences: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in self.sequences:
            if not isinstance(name, str) or not _NAME.fullmatch(name):
                raise ValueError(f"sequence is {str(name)[:80]!r}, needs a name of letters, digits, - and _")
        if len(set(self.sequences)) != len(self.sequences):
            raise ValueError("sequences: a name is there twice")

    def to_json(self) -> str:
        """One JSON object; read_dataset reads it."""
        fields = {"preset": self.preset, "scenario": self.scenario, "views": self.views, "form": self.form, "sequences": list(self.sequences)}
        return json.dumps({"schema": SCHEMA} | fields, indent=1, allow_nan=False) + "\n"


def read_dataset(folder: Path) -> Dataset:
    """dataset.json of a folder. Raises ValueError, with the file's name, where it is not there, of another schema or not what it should be."""
    path = folder / FILE
    content = read_json(path)
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema != SCHEMA:
        raise ValueError(f"{path}: schema is {str(schema)[:80]}, this version reads {SCHEMA}")
    kinds: dict[str, type] = {"preset": str, "scenario": dict, "views": int, "form": dict, "sequences": list}
    for name, kind in kinds.items():
        if not isinstance(content.get(name), kind):
            raise ValueError(f"{path}: {name} is {str(content.get(name))[:80]!r}, needs a JSON value of kind {kind.__name__}")
    try:
        return Dataset(**{name: content[name] for name in kinds} | {"sequences": tuple(content["sequences"])})
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def sequences(folder: Path) -> list[Path]:
    """Folders of the sequences in `folder`: itself where it is a sequence, else the whole ones of a dataset, in its order.

    Raises ValueError where it is neither, or where no sequence of the dataset is whole yet.
    """
    if (folder / MANIFEST).is_file():
        return [folder]
    if not (folder / FILE).is_file():
        raise ValueError(f"{folder}: neither a sequence ({MANIFEST}) nor a dataset ({FILE})")
    whole = [folder / name for name in read_dataset(folder).sequences if (folder / name / MANIFEST).is_file()]
    if not whole:
        raise ValueError(f"{folder}: no sequence of this dataset is whole yet")
    return whole
