"""Synthetic result folders of stress tests. Scores are a formula, so that reports of them can be checked."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

PEOPLE = (5, 20, 50, 100)
VERSIONS = {"pilsim": "0.3.0", "python": "3.11.2", "mujoco": "4.0.0"}


def row(sweep: str, k: int, value: Any, seed: int, **changes: Any) -> dict[str, Any]:
    """A complete row. MOTA is 1 − people / 125, with a small change for each seed."""
    people = value if sweep == "density" else 10
    noise = 0.01 * ((seed * 7 + k) % 5 - 2)
    truths, loss = 60 * people, people / 125 - noise
    misses, false, switches = (round(share * loss * truths) for share in (0.7, 0.2, 0.1))
    part = {"poses": 0.1 * loss, "detections": 0.6 * loss, "association": 0.25 * loss, "terrain": 0.05 * loss, "total": loss}
    content = {
        "schema": 1,
        "id": f"{sweep}/{k}",
        "sweep": sweep,
        "parameter": {"density": "people", "terrain": "terrain"}.get(sweep, sweep),
        "value": value,
        "seed": seed,
        "scenario": {"world": "pilsun", "people": people, "frames": 60, "seed": seed, "robots": 4},
        "tracker": {"name": "default", "options": {}},
        "rendered": False,
        "seconds": 12.5,
        "error": None,
        "scores": {
            "mota": 1 - loss, "mota_all": 0.95 - loss, "idf1": 0.98 - loss, "hota": 0.8 - loss, "motp_m": 0.08, "false_positives": false,
            "misses": misses, "switches": switches, "truths": truths, "ate_m": 0.03 + 0.001 * people + 0.1 * noise, "dead_reckoning_m": 0.2,
            "efficiency": (0.03 + 0.001 * people + 0.1 * noise) / 0.02, "map_aligned_m": 0.04, "map_complete": 0.8, "map_ghosts": 0.1,
        },
        "limits": {"visible_recall": 1 - people / 500, "ate_bound_m": 0.02, "clique_gap": 0.0},
        "causes": {
            "misses": {"occluded": round(0.6 * misses), "nobody saw it": misses - round(0.6 * misses)},
            "false positives": {"merged": false},
            "switches": {"merged": switches},
        },
        "ladder": {"mota": part, "metres": {name: 0.1 * share for name, share in part.items()}, "combinations": {}},
        "moments": [],
        "versions": VERSIONS,
        "command": f"pilsim stress --sweep {sweep} --seeds 5 --no-render --out runs/stress",
    }  # fmt: skip
    return content | changes


def density(seeds: int = 5) -> list[dict[str, Any]]:
    return [row("density", k, value, seed) for k, value in enumerate(PEOPLE) for seed in range(seeds)]


def terrain(seeds: int = 5) -> list[dict[str, Any]]:
    """A sweep over names without a difference in scores."""
    return [row("terrain", k, value, seed) for k, value in enumerate(("exact", "coarse", "flat")) for seed in range(seeds)]


def failed(content: dict[str, Any], error: str) -> dict[str, Any]:
    return content | {"error": error, "scores": None, "limits": None, "causes": None, "ladder": None}


def moment(folder: Path, name: str, weight: float = 3.0, **changes: Any) -> dict[str, Any]:
    """A moment whose picture is written into the folder."""
    (folder / "moments").mkdir(parents=True, exist_ok=True)
    image = np.random.default_rng(len(name)).integers(0, 255, (16, 32, 3), dtype=np.uint8)
    picture = cv2.resize(image, (1600, 800), interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(str(folder / "moments" / f"{name}.png"), picture)
    content = {"frame": 34, "kind": "switch", "cause": "merged", "person": 4, "position": [1.0, 2.0, 0.25], "weight": weight}
    return content | {"pictures": [f"moments/{name}.png"]} | changes


def write(folder: Path, rows: list[dict[str, Any]], tail: str = "") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "results.jsonl").write_text("".join(json.dumps(content) + "\n" for content in rows) + tail, encoding="utf-8")
    (folder / "run.json").write_text(json.dumps({"schema": 1, "command": "pilsim stress --out runs/stress", "versions": VERSIONS}))
    return folder
