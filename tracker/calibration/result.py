"""Prior knowledge of a calibration, and its result: cameras, clock offsets, covariances, and what the data leave undetermined."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tracker.calibration.body import FOCAL, HEIGHT, NAMES, OFFSET, PITCH, ROLL, YAW, X, Y
from tracker.calibration.single_view import STATURE
from tracker.geometry import Array
from tracker.geometry.cameras import LensCamera
from tracker.geometry.ground import Flat
from tracker.recordings import Recording, RecordingCamera
from tracker.recordings.clock_offsets import with_offsets

MOST_OFFSET = 5.0
"""Largest offset between the clocks of two cameras, unless another is known, s."""


@dataclass(frozen=True)
class Known:
    """Prior knowledge beside the boxes. heights: camera → m above the ground. distances: two cameras → m.

    stature: mean of people, m; None where it is not known. principal, k1: whether to estimate the principal point, and k1, too.
    refine: whether cameras with a given pose may have moved. clock: largest offset between the clocks of two cameras, s.
    """

    heights: Mapping[str, float] = field(default_factory=dict)
    distances: Mapping[tuple[str, str], float] = field(default_factory=dict)
    stature: float | None = STATURE
    principal: bool = False
    k1: bool = False
    refine: bool = False
    clock: float = MOST_OFFSET


@dataclass(frozen=True, eq=False)
class Calibration:
    """Calibrated cameras with the uncertainty of their parameters.

    cameras: name → camera. offsets: name → s to add to its times. rows (cameras, 11): parameters as in body.NAMES; covariance (cameras · 11, same).
    problems: lines on what the data leave undetermined; with any, the result is a guess. figures: of the fit. paths: person → times s, places m.
    moved_frame: whether the world frame is new, because no camera had a pose. changes: lines on what a refinement changed.
    """

    cameras: dict[str, RecordingCamera]
    offsets: dict[str, float]
    rows: Array
    covariance: Array
    problems: tuple[str, ...]
    figures: dict[str, float]
    paths: dict[int, tuple[Array, Array]]
    moved_frame: bool = True
    changes: tuple[str, ...] = ()

    @property
    def sigma(self) -> dict[str, Array]:
        """Standard deviations (11,) of each camera's parameters in the frame of the result."""
        return dict(zip(self.cameras, np.sqrt(np.abs(np.diag(self.covariance))).reshape(-1, len(NAMES)), strict=True))

    @property
    def place_sigma(self) -> Array:
        """Standard deviations (cameras,) m of the cameras' places in the frame of the result."""
        s = np.array(list(self.sigma.values())).reshape(-1, len(NAMES))
        return np.asarray(np.sqrt(s[:, X] ** 2 + s[:, Y] ** 2 + (np.exp(self.rows[:, HEIGHT]) * s[:, HEIGHT]) ** 2))

    def applied(self, recording: Recording) -> Recording:
        """The recording with these cameras and clocks.

        If the world frame is new, truth, area and terrain are left out, as are robots and cameras without boxes. Cameras with boxes whose place is
        not known lose their pose.
        """
        late = {name: seconds for name, seconds in self.offsets.items() if seconds}
        changed = replace(with_offsets(recording, late), cameras={**recording.cameras, **self.cameras})
        if not self.moved_frame:
            return changed
        changed = changed.choose([name for name in recording.fixed if name in self.cameras or recording.detections.get(name)])
        lost = {name: camera.without_pose() for name, camera in changed.cameras.items() if name not in self.cameras}
        cameras = {**changed.cameras, **lost}
        return replace(changed, cameras=cameras, truth=None, visible={}, area=None, ground=Flat(), occluders=None, pillars=np.zeros((0, 5)))

    def lines(self) -> list[str]:
        """A table of the cameras, each parameter with its standard deviation."""
        width = max([6, *map(len, self.cameras)])
        heads = {"focal [px]": 14, "pitch [°]": 13, "roll [°]": 13, "yaw [°]": 14, "x, y, height [m]": 24, "±": 5, "clock [s]": 15}
        out = [" ".join([f"{'camera':{width}}", *(f"{head:>{wide}}" for head, wide in heads.items())])]
        for (name, camera), row, error in zip(self.cameras.items(), self.rows, self.place_sigma.tolist(), strict=True):
            s = self.sigma[name]
            lens = camera.camera
            focal = f"{lens.fx:.0f} ± {lens.fx * s[FOCAL]:.0f}" if isinstance(lens, LensCamera) else "-"
            pitch, roll, yaw = (f"{np.degrees(row[p]):.2f} ± {np.degrees(s[p]):.2f}" for p in (PITCH, ROLL, YAW))
            place = ", ".join(f"{value:.2f}" for value in (row[X], row[Y], np.exp(row[HEIGHT])))
            clock = f"{row[OFFSET]:.3f} ± {s[OFFSET]:.3f}"
            out.append(f"{name:{width}} {focal:>14} {pitch:>13} {roll:>13} {yaw:>14} {place:>24} {error:>5.2f} {clock:>15}")
        return out

    def to_json(self) -> dict[str, Any]:
        """The content of calibrated.json."""
        return {
            "parameters": list(NAMES),
            "cameras": {
                name: {"values": row.tolist(), "sigma": self.sigma[name].tolist(), "offset_s": self.offsets[name]}
                for (name, row) in zip(self.cameras, self.rows, strict=True)
            },
            "covariance": self.covariance.tolist(),
            "figures": self.figures,
            "problems": list(self.problems),
            "changes": list(self.changes),
        }
