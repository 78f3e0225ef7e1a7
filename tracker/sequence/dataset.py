"""A dataset: a folder of sequences generated from one preset, and dataset.json, which describes them.

Only a folder with a manifest is a sequence. A sequence that is being written has a temporary name.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tracker.io.json_files import JsonObject, read_json

SCHEMA = 1
"""Version of dataset.json; the manifest of each sequence has its own version."""
FILE, MANIFEST = "dataset.json", "manifest.json"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")


@dataclass(frozen=True)
class Dataset:
    """The content of dataset.json.

    preset: the kind of sequences. scenario: of the first sequence, as JSON values; the following sequences have consecutive seeds.
    views: number of fixed cameras. form: options of the written files, as JSON values. sequences: names of the folders, in order.
    Raises ValueError for a name that is no plain folder name, or occurs twice.
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
            raise ValueError("sequences: a name occurs twice")

    def to_json(self) -> str:
        """The text of dataset.json; read_dataset reads it."""
        fields = {"preset": self.preset, "scenario": self.scenario, "views": self.views, "form": self.form, "sequences": list(self.sequences)}
        return json.dumps({"schema": SCHEMA} | fields, indent=1, allow_nan=False) + "\n"


def read_dataset(folder: Path) -> Dataset:
    """Read dataset.json of a folder. Raises ValueError with the path for a missing file, another schema, and invalid fields."""
    path = folder / FILE
    content = JsonObject(read_json(path), str(path))
    content.check_schema(SCHEMA)
    kinds: dict[str, type] = {"preset": str, "scenario": dict, "views": int, "form": dict, "sequences": list}
    fields = {name: content.a(name, kind) for name, kind in kinds.items()}
    try:
        return Dataset(**fields | {"sequences": tuple(fields["sequences"])})
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def sequences(folder: Path) -> list[Path]:
    """Folders of the sequences in `folder`: `folder` itself if it is a sequence, else the complete sequences of a dataset, in its order.

    Raises ValueError where `folder` is neither, and where no sequence of the dataset is complete.
    """
    if (folder / MANIFEST).is_file():
        return [folder]
    if not (folder / FILE).is_file():
        raise ValueError(f"{folder}: neither a sequence ({MANIFEST}) nor a dataset ({FILE})")
    complete = [folder / name for name in read_dataset(folder).sequences if (folder / name / MANIFEST).is_file()]
    if not complete:
        raise ValueError(f"{folder}: no sequence of this dataset is complete yet")
    return complete
