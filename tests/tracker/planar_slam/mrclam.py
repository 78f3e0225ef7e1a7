"""A small MRCLAM data set: two robots on circles among four landmarks."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from tests.templates import copied

BEGIN, SECONDS = 1000.0, 60.0
LANDMARKS = {6: (3.0, 0.5), 7: (-2.0, 2.5), 8: (0.5, -3.0), 9: (1.0, 3.5)}
CODES = {1: 5, 2: 14, 6: 72, 7: 27, 8: 54, 9: 70}


def write_set(folder: Path, rate: float = 50.0) -> Path:
    """Robots that do what they are told at once, 0.1 m/s and ∓0.1 rad/s, and see all there is twice a second, nearly without noise."""
    copied(folder, ("mrclam", rate), partial(_write, rate=rate))
    return folder


def _write(folder: Path, rate: float) -> None:
    folder.mkdir()
    rng = np.random.default_rng(3)
    (folder / "Barcodes.dat").write_text("# Subject # Barcode #\n" + "".join(f" {s} \t {c} \n" for s, c in CODES.items()))
    lines = "".join(f" {s} \t {x} \t {y} \t 0.0001 \t 0.0001\n" for s, (x, y) in LANDMARKS.items())
    (folder / "Landmark_Groundtruth.dat").write_text("# Subject # x y std std\n" + lines)
    poses = {}
    t = np.arange(0, SECONDS, 1 / rate)
    for n, turn in ((1, 0.1), (2, -0.1)):
        h = n + turn * t
        x, y = n - 1 + (np.sin(h) - np.sin(n)) * 0.1 / turn, -(np.cos(h) - np.cos(n)) * 0.1 / turn
        poses[n] = np.stack([t + BEGIN, x, y, (h + np.pi) % (2 * np.pi) - np.pi], axis=1)
        np.savetxt(folder / f"Robot{n}_Groundtruth.dat", poses[n], "%.6f", header="Time x y heading")
        np.savetxt(folder / f"Robot{n}_Odometry.dat", np.stack([t + BEGIN, np.full_like(t, 0.1), np.full_like(t, turn)], axis=1), "%.6f")
    for n in (1, 2):
        rows = []
        for k in range(0, len(t), round(rate / 2)):
            seen = {s: np.array(p) for s, p in LANDMARKS.items()} | {3 - n: poses[3 - n][k, 1:3]}
            for s, place in seen.items():
                d = place - poses[n][k, 1:3] + 0.001 * rng.normal(size=2)
                rows.append([t[k] + BEGIN, CODES[s], np.hypot(*d), (np.arctan2(d[1], d[0]) - poses[n][k, 3] + np.pi) % (2 * np.pi) - np.pi])
        np.savetxt(folder / f"Robot{n}_Measurement.dat", rows, ["%.6f", "%d", "%.6f", "%.6f"])
