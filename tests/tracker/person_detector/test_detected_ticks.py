"""People found in the views of ticks by several threads: the same ticks and tracks as with one, errors in their place, and an early end."""

from __future__ import annotations

import pickle
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from tests.tracker import sequences
from tests.tracker.person_detector.blob_network import picture_with, write_blob_network
from tracker.geometry import Pose
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.person_detector.detected_ticks import DetectedTicks
from tracker.pipeline import track
from tracker.types import Odometry, Setup, Start, Tick, TicksInMemory

FRAMES = 12


def setup() -> Setup:
    """Two rovers far from each other, since both see the same pictures."""
    there = sequences.setup()
    mounts = {name: replace(mount, camera=Panorama(512, 256)) for name, mount in there.mounts.items()}
    starts: dict[str, Start | None] = {f"robot_{k}": Start(Pose.planar(80 * k, 0, 0), 1e-6 * np.eye(6)) for k in range(2)}
    return replace(there, mounts=mounts, starts=starts, ground=Flat())


def ticks() -> TicksInMemory:
    """Two rovers that stand, and two blobs below the horizon that move."""
    rng, out = np.random.default_rng(0), []
    for k in range(FRAMES):
        image = picture_with((256, 512), [(62.0 + 4 * k, 142.0), (302.0, 146.0)])
        still = Odometry(Pose.exp(np.zeros(6)), 1e-8 * np.eye(6)) if k else None
        views = [replace(view, image=image, odometry=still, robot_detections=None) for view in sequences.tick(k, rng).views]
        out.append(Tick(k, k / 6, tuple(views)))
    return TicksInMemory(tuple(out), setup().mounts)


def test_threads_change_nothing(tmp_path: Path) -> None:
    model = write_blob_network(tmp_path / "m.onnx", spread=0.1)
    found = {n: list(DetectedTicks(ticks(), setup(), model, n)) for n in (1, 2, 3)}
    assert [len(view.detections) for tick in found[1] for view in tick.views] == [2] * 2 * FRAMES
    assert pickle.dumps(found[1]) == pickle.dumps(found[2]) == pickle.dumps(found[3])
    tracks = [[(e.target_id.tobytes(), e.position.tobytes(), e.covariance.tobytes()) for e in track(setup(), found[n])] for n in (1, 2)]
    assert tracks[0] == tracks[1]
    assert any(ids for ids, _, _ in tracks[0])


@dataclass(frozen=True, eq=False)
class EndsInError:
    """Ticks of which the fourth cannot be read."""

    ticks: TicksInMemory

    def __len__(self) -> int:
        return len(self.ticks)

    def __iter__(self) -> Iterator[Tick]:
        for k, tick in enumerate(self.ticks):
            if k == 3:
                raise ValueError("image 3 is damaged")
            yield tick

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        return self.ticks.odometry()


def test_an_error_comes_in_its_place_and_no_thread_is_left(tmp_path: Path) -> None:
    model, before = write_blob_network(tmp_path / "m.onnx"), threading.active_count()
    found = iter(DetectedTicks(EndsInError(ticks()), setup(), model, 2))
    assert [next(found).index for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ValueError, match="image 3 is damaged"):
        next(found)
    assert next(iter(DetectedTicks(ticks(), setup(), model, 2))).index == 0
    assert threading.active_count() == before
