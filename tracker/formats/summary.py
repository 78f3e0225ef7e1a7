"""Summary of a dataset or a recording: frames, cameras, people, boxes, crowd density and file sizes."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.formats.opening import format_of, is_pilsim, open_recording
from tracker.formats.registry import UTIAS
from tracker.io.csv_tables import read_table
from tracker.io.json_files import read_json
from tracker.planar_slam.utias_files import read_utias
from tracker.recordings import Recording
from tracker.recordings.camera_json import model_of
from tracker.sequence.dataset import sequences
from tracker.sequence.manifest import read_manifest
from tracker.sequence.reader import read_flat_setup
from tracker.sequence.robot_sensors import SENSOR_TABLES, read_sensor_setup
from tracker.sequence.schema import BOXES, ROBOTS
from tracker.sequence.truth_tables import people_columns_of

SEEN = 0.2
"""Least visible fraction of a person who counts as seen."""


def summarize(folder: Path) -> dict[str, Any]:
    """Summarize a source as JSON values. Checksums are not verified.

    Sequences of pilsim give `sequences`, a list with one entry each, and `total`. A recording or a UTIAS set gives `format` and its figures.
    Raises ValueError with the path for missing or invalid content.
    """
    if not is_pilsim(folder):
        form = format_of(folder)
        return {"folder": str(folder), "format": form.name} | (_of_utias(folder) if form.name == UTIAS else _of_recording(open_recording(folder)))
    rows = [_of_sequence(path) for path in sequences(folder)]
    total = {name: sum(row[name] for row in rows) for name in ("frames", "images", "boxes", "seen", "files", "bytes")}
    kinds: Counter[str] = Counter()
    for row in rows:
        kinds.update(row["bytes_of"])
    return {"folder": str(folder), "sequences": rows, "total": {"sequences": len(rows)} | total | {"bytes_of": dict(kinds)}}


def _of_sequence(folder: Path) -> dict[str, Any]:
    manifest, scenario = read_manifest(folder), read_json(folder / "scenario.json")
    setup = read_flat_setup(folder)
    mounted = {name: mount.camera for name, mount in setup.mounts.items()}
    cameras = {name: f"{type(camera).__name__.lower()} {camera.width} x {camera.height}" for name, camera in mounted.items()}
    people = read_table(folder / "truth" / "people.csv", people_columns_of(folder, setup.mounts))
    boxes = read_table(folder / "truth" / "boxes.csv", BOXES)
    frames = _frame_count(folder, people["frame"])
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
        "seconds": round(frames * setup.period, 6),
        "rate": round(1 / setup.period, 6),
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
    } | _of_sensors(folder, manifest["files"])


def _frame_count(folder: Path, with_people: NDArray[np.int64]) -> int:
    """The number of frames in truth/robots.csv. with_people: frames of the rows of people.csv. Raises ValueError for frames out of order."""
    frames = read_table(folder / "truth" / "robots.csv", ROBOTS)["frame"]
    count = len(np.unique(frames))
    if count and (frames.min(), frames.max()) != (0, count - 1):
        raise ValueError(f"{folder / 'truth' / 'robots.csv'}: frames are not 0 to {count - 1} without gaps")
    if with_people.min(initial=0) < 0 or with_people.max(initial=-1) >= count:
        raise ValueError(f"{folder / 'truth' / 'people.csv'}: a frame is not in the sequence, which has {count}")
    return count


def _of_sensors(folder: Path, files: dict[str, Any]) -> dict[str, Any]:
    """Entries of the robots' own sensors, only where the sequence has them: part and rate of the IMU, rate of the wheels, number of clocks."""
    sensors = read_sensor_setup(folder)
    out: dict[str, Any] = {}
    for name in ("imu", "wheels"):
        if f"{name}.csv" in files:
            if name not in sensors.description:
                raise ValueError(f"{folder / 'sensors.json'}: has no {name}, though there is {name}.csv")
            entry = sensors.description[name]
            rows = len(read_table(folder / f"{name}.csv", SENSOR_TABLES[name])["time"])
            out[name] = {"name": str(entry.get("name"))[:40]} if name == "imu" else {}
            out[name] |= {"rate": entry["rate"], "samples": rows}
    return out | ({"clocks": len(sensors.clocks)} if sensors.clocks else {})


def _sensors_text(row: dict[str, Any]) -> str:
    parts = [f"IMU {row['imu']['name']} at {row['imu']['rate']:g} Hz"] if "imu" in row else []
    parts += [f"wheels at {row['wheels']['rate']:g} Hz"] if "wheels" in row else []
    parts += [f"{row['clocks']} clocks with errors"] if "clocks" in row else []
    return f" {', '.join(parts)};" if parts else ""


def _of_recording(recording: Recording) -> dict[str, Any]:
    boxes = {name: sum(len(box) for box, _ in recording.detections.get(name, {}).values()) for name in recording.cameras}
    people = list((recording.truth or {}).values())
    places = np.concatenate([np.zeros((0, 3)), *(positions for _, positions in people)])
    truth = {
        "people": len({person for ids, _ in people for person in ids.tolist()}),
        "at_once": max((len(ids) for ids, _ in people), default=0),
        "a_square_metre": round(len(places) / max(1, len(people)) / _bounding_area(places[:, 0], places[:, 1]), 4) if len(places) else 0.0,
    }
    return {
        "frames": recording.frames,
        "seconds": round(recording.frames / recording.rate, 6),
        "rate": round(recording.rate, 6),
        "cameras": {name: f"{model_of(c.camera)} {c.camera.width} x {c.camera.height}" for name, c in recording.cameras.items()},
        "robots": list(recording.robots),
        "boxes": boxes,
        "images": sorted(recording.images),
        "truth": truth if recording.truth is not None else None,
    }


def _of_utias(folder: Path) -> dict[str, Any]:
    team = read_utias(folder)
    seconds = max(robot.odometry[-1, 0] for robot in team.robots.values()) - min(robot.odometry[0, 0] for robot in team.robots.values())
    return {
        "seconds": round(float(seconds), 3),
        "robots": {f"Robot{n}": {"odometry": len(robot.odometry), "measurements": len(robot.measurements)} for n, robot in team.robots.items()},
        "landmarks": len(team.landmarks),
    }


def _bounding_area(x: Any, y: Any) -> float:
    """Area m² of the bounding box of all feet, at least 1 m²."""
    return max(1.0, float(np.ptp(x) * np.ptp(y)))


def summary_text(summary: dict[str, Any]) -> str:
    """The result of `summarize` as text: a line for each sequence and one for the total."""
    if "format" in summary:
        return _source_text(summary)
    lines = []
    for row in summary["sequences"]:
        kinds = Counter(row["cameras"].values())
        lines.append(
            f"{row['name']}: {row['frames']} frames at {row['rate']:g}/s, {', '.join(f'{n} {kind}' for kind, n in kinds.items())};"
            f" world {row['world']}, seed {row['seed']}; {row['people']} people, up to {row['at_once']} at once, {row['a_square_metre']:g} a m²;"
            f" {row['boxes']} boxes ({row['seen']} seen);{_sensors_text(row)} {row['bytes'] / 1e6:.1f} MB"
        )
    total = summary["total"]
    sizes = ", ".join(f"{name} {size / 1e6:.1f}" for name, size in sorted(total["bytes_of"].items(), key=lambda item: -item[1]))
    lines.append(
        f"{total['sequences']} sequence{'s' * (total['sequences'] != 1)}, {total['frames']} frames, {total['images']} images, {total['boxes']} boxes,"
        f" {total['files']} files, {total['bytes'] / 1e6:.1f} MB ({sizes})"
    )
    return "\n".join(lines)


def _source_text(summary: dict[str, Any]) -> str:
    """A recording or a UTIAS set as text: a line for the whole and one for each camera or robot."""
    if summary["format"] == UTIAS:
        rows = [f"  {name}: {row['odometry']} rows of odometry, {row['measurements']} measurements" for name, row in summary["robots"].items()]
        return "\n".join([f"{summary['folder']}: {UTIAS}, {summary['seconds']:g} s, {summary['landmarks']} landmarks", *rows])
    truth = summary["truth"]
    known = "no truth"
    if truth is not None:
        known = f"truth of {truth['people']} people, up to {truth['at_once']} at once, {truth['a_square_metre']:g} a m²"
    head = f"{summary['folder']}: {summary['format']}, {summary['frames']} frames at {summary['rate']:g}/s ({summary['seconds']:g} s); {known}"
    rows = [
        f"  {name}: {kind}, {summary['boxes'][name]} boxes{', images' if name in summary['images'] else ''}"
        for name, kind in summary["cameras"].items()
    ]
    return "\n".join([head, *rows])
