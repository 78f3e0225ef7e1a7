"""manifest.json: the files of a sequence with their checksums, read as a file of unknown origin.

README.md in the folder of a sequence (schema.README) describes each file.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tracker.io.json_files import read_json
from tracker.io.resume import checksum
from tracker.sequence.schema import READABLE_SCHEMAS, REQUIRED_FILES


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read manifest.json: schema, versions, and files (name → sha256 and bytes). No other file is opened.

    Raises ValueError with the path for invalid content, an unreadable schema version, and names outside the folder.
    """
    path = folder / "manifest.json"
    manifest = read_json(path)
    schema = manifest.get("schema") if isinstance(manifest, dict) else None
    if schema not in READABLE_SCHEMAS or isinstance(schema, bool):
        raise ValueError(f"{path}: {schema_fault(schema)}")
    if not isinstance(manifest.get("files"), dict):
        raise ValueError(f"{path}: has no files")
    for name, entry in manifest["files"].items():
        if not isinstance(entry, dict) or not isinstance(entry.get("bytes"), int) or not isinstance(entry.get("sha256"), str):
            raise ValueError(f"{path}: entry {name[:80]!r} has no sha256 and bytes")
        if Path(name).is_absolute() or ".." in Path(name).parts or "\0" in name:
            raise ValueError(f"{path}: entry {name[:80]!r} lies outside the folder")
    missing = [name for name in REQUIRED_FILES if name not in manifest["files"]]
    if missing:
        raise ValueError(f"{path}: does not name {missing[0]}")
    return dict(manifest)


def check_file(folder: Path, name: str, entry: Mapping[str, Any], sums: bool = True) -> None:
    """Raises ValueError with the path where a file is missing, links outside the folder, or differs from its entry in the manifest.

    sums: compare the SHA-256 as well as the size.
    """
    file = folder / name
    if not file.is_file():
        raise ValueError(f"{file}: missing, though the manifest names it")
    if not file.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"{file}: is a link to outside the folder")
    if file.stat().st_size != entry["bytes"]:
        raise ValueError(f"{file}: {file.stat().st_size} bytes, the manifest says {entry['bytes']}: truncated or changed")
    if sums and checksum(file) != entry["sha256"]:
        raise ValueError(f"{file}: its SHA-256 is not the manifest's: changed")


def schema_fault(schema: object) -> str:
    """The reason why a sequence of that schema version cannot be read."""
    said = f"schema is {str(schema)[:80]}, this version reads {' and '.join(map(str, READABLE_SCHEMAS))}"
    if schema == 1:
        return f"{said}: version 1 has no key points and no camera poses; generate it again"
    return f"{said}: a newer pilsim wrote it" if isinstance(schema, int) and schema > max(READABLE_SCHEMAS) else said


def manifest_checksum(manifest: dict[str, Any]) -> str:
    """SHA-256 of the content of a manifest without its field `sum`."""
    text = json.dumps({key: value for key, value in manifest.items() if key != "sum"}, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
