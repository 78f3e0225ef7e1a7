"""manifest.json: what files a sequence has, and their sums; read as what a stranger may have written.

The folder's own README.md (layout.README) says what every file is.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tracker.io.json_files import read_json
from tracker.sequence.schema import NEEDED, READS


def read_manifest(folder: Path) -> dict[str, Any]:
    """manifest.json: schema, versions, files (name → sha256 and bytes), their form checked and names within the folder; nothing else is opened.

    Raises ValueError where it is none, of a schema that is not read, or names a file outside of the folder.
    """
    path = folder / "manifest.json"
    manifest = read_json(path)
    schema = manifest.get("schema") if isinstance(manifest, dict) else None
    if schema not in READS or isinstance(schema, bool):
        raise ValueError(f"{path}: {schema_fault(schema)}")
    if not isinstance(manifest.get("files"), dict):
        raise ValueError(f"{path}: has no files")
    for name, entry in manifest["files"].items():
        if not isinstance(entry, dict) or not isinstance(entry.get("bytes"), int) or not isinstance(entry.get("sha256"), str):
            raise ValueError(f"{path}: entry {name[:80]!r} has no sha256 and bytes")
        if Path(name).is_absolute() or ".." in Path(name).parts or "\0" in name:
            raise ValueError(f"{path}: entry {name[:80]!r} lies outside the folder")
    missing = [name for name in NEEDED if name not in manifest["files"]]
    if missing:
        raise ValueError(f"{path}: does not name {missing[0]}")
    return dict(manifest)


def check_file(folder: Path, name: str, entry: Mapping[str, Any], sums: bool = True) -> None:
    """Raises ValueError, with the file's name, where a file is not there, leads out of the folder, or is not as its entry in the manifest says.

    sums: look at the SHA-256 too.
    """
    file = folder / name
    if not file.is_file():
        raise ValueError(f"{file}: missing, though the manifest names it")
    if not file.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"{file}: is a link to outside the folder")
    if file.stat().st_size != entry["bytes"]:
        raise ValueError(f"{file}: {file.stat().st_size} bytes, the manifest says {entry['bytes']}: truncated or changed")
    if sums:
        with file.open("rb") as content:
            if hashlib.file_digest(content, "sha256").hexdigest() != entry["sha256"]:
                raise ValueError(f"{file}: its SHA-256 is not the manifest's: changed")


def schema_fault(schema: object) -> str:
    """Why a sequence of that schema version is not read."""
    said = f"schema is {str(schema)[:80]}, this version reads {' and '.join(map(str, READS))}"
    if schema == 1:
        return f"{said}: before 2 there were no key points and no poses of cameras; generate it again"
    return f"{said}: a newer pilsim wrote it" if isinstance(schema, int) and schema > max(READS) else said


def manifest_sum(manifest: dict[str, Any]) -> str:
    """SHA-256 of all that a manifest says but for its sum."""
    text = json.dumps({key: value for key, value in manifest.items() if key != "sum"}, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
