"""Summary of a dataset: sequences, frames, cameras, people, boxes, crowd density and file sizes."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from tracker.io.csv_tables import read_table
from tracker.io.json_files import read_json
from tracker.sequence.dataset import sequences
from tracker.sequence.manifest import read_manifest
from tracker.sequence.reader import read_contents
from tracker.sequence.schema import BOXES, people_columns

SEEN = 0.2
"""Least visible fraction of a person who counts as seen."""


def summarize(folder: Path) -> dict[str, Any]:
    """Summarize a sequence or a dataset as JSON values: `sequences`, a list with one entry each, and `total`. Checksums are not verified.

    Raises ValueError with the path for missing or invalid content.
    """
    rows = [_of_sequence(path) for path in sequences(folder)]
    total = {name: sum(row[name] for row in rows) for name in ("frames", "images", "boxes", "seen", "files", "bytes")}
    kinds: Counter[str] = Counter()
    for row in rows:
        kinds.update(row["bytes_of"])
    return {"folder": str(folder), "sequences": rows, "total": {"sequences": len(rows)} | total | {"bytes_of": dict(kinds)}}


def _of_sequence(folder: Path) -> dict[str, Any]:
    manifest, scenario = read_manifest(folder), read_json(folder / "scenario.json")
    sequence = read_contents(folder, manifest["files"])
    mounted = {name: mount.camera for name, mount in sequence.setup.mounts.items()}
    cameras = {name: f"{type(camera).__name__.lower()} {camera.width} x {camera.height}" for name, camera in mounted.items()}
    people = read_table(folder / "truth" / "people.csv", people_columns(sequence.setup.mounts))
    boxes = read_table(folder / "truth" / "boxes.csv", BOXES)
    frames = len(sequence.truth or ())
    present = np.bincount(people["frame"].astype(np.int64), minlength=frames) if frames else np.zeros(1, np.int64)
    sizes: Counter[str] = Counter()
    for name, entry in manifest["files"].items():
        parts = Path(name).parts
        sizes[parts[0] if len(parts) > 1 else Path(name).suffix.lstrip(".")] += entry["bytes"]
    return {
        "name": folder.resolve().name,
        "schema": manifest["schema"],
        "world": scenario.get("world") if isinstance(scenario, dict) else None,
        "seed": scenario.get("seed") if isinstance(scenario, dict) else None,
        "frames": frames,
        "seconds": round(frames * sequence.setup.period, 6),
        "rate": round(1 / sequence.setup.period, 6),
        "cameras": cameras,
        "images": sum(name.startswith("images/") for name in manifest["files"]),
        "people": len(np.unique(people["person"])),
        "at_once": int(present.max()),
        "boxes": len(boxes["frame"]),
        "seen": int((boxes["visible"] >= SEEN).sum()) if len(boxes["frame"]) else 0,
        "a_square_metre": round(float(present.mean()) / _bounding_area(people["x"], people["y"]), 4) if len(people["x"]) else 0.0,
        "files": len(manifest["files"]) + 1,
        "bytes": sum(sizes.values()),
        "bytes_of": dict(sizes),
    }


def _bounding_area(x: Any, y: Any) -> float:
    """Area m² of the bounding box of all feet, at least 1 m²."""
    return max(1.0, float(np.ptp(x) * np.ptp(y)))


def summary_text(summary: dict[str, Any]) -> str:
    """The result of `summarize` as text: a line for each sequence and one for the total."""
    lines = []
    for row in summary["sequences"]:
        kinds = Counter(row["cameras"].values())
        lines.append(
            f"{row['name']}: {row['frames']} frames at {row['rate']:g}/s, {', '.join(f'{n} {kind}' for kind, n in kinds.items())};"
            f" world {row['world']}, seed {row['seed']}; {row['people']} people, up to {row['at_once']} at once, {row['a_square_metre']:g} a m²;"
            f" {row['boxes']} boxes ({row['seen']} seen); {row['bytes'] / 1e6:.1f} MB"
        )
    total = summary["total"]
    sizes = ", ".join(f"{name} {size / 1e6:.1f}" for name, size in sorted(total["bytes_of"].items(), key=lambda item: -item[1]))
    lines.append(
        f"{total['sequences']} sequences, {total['frames']} frames, {total['images']} images, {total['boxes']} boxes,"
        f" {total['files']} files, {total['bytes'] / 1e6:.1f} MB ({sizes})"
    )
    return "\n".join(lines)
