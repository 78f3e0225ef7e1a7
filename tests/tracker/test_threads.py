"""Tracking in several threads: the same estimates to the bit, a bounded number of ticks in memory, errors in their place, and no thread left."""

from __future__ import annotations

import pickle
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.tracker.person_detector.test_detected_ticks import setup as rovers
from tests.tracker.street import NAME, Street
from tracker.detections.front_end import ImageParameters
from tracker.detections.optical_flow import TrackletParameters
from tracker.geometry import Pose
from tracker.geometry.cameras import Panorama
from tracker.pipeline import Parameters, track
from tracker.types import Detections, Odometry, Setup, Start, Tick, View

Scene = tuple[Setup, list[Tick], Parameters]


def robots() -> Scene:
    """Two rovers that drive between balls, each between its own."""
    rng, camera, mounts = np.random.default_rng(0), Panorama(512, 256), rovers().mounts
    step = Odometry(Pose.exp(np.array([0.2, 0, 0, 0, 0, 0])), 1e-5 * np.eye(6), np.array([0.0, 0.0, 1.0]), 0.01)
    balls = [rng.uniform((-6, -6, -1), (8, 6, 2), (300, 3)) for _ in mounts]
    sizes, colours = rng.uniform(0.05, 0.25, 300), rng.integers(0, 255, (300, 3)).tolist()
    out = []
    for k in range(10):
        views = []
        for name, places in zip(mounts, balls, strict=True):
            at = places - (0.2 * k, 0, 0)
            away = np.linalg.norm(at, axis=1)
            pixels, _ = camera.pixels_from_bearings(at / away[:, None])
            image = np.full((256, 512, 3), 128, np.uint8)
            for i in np.argsort(-away):
                cv2.circle(image, tuple((16 * pixels[i]).astype(int).tolist()), int(16 * 80 * sizes[i] / away[i]), colours[i], -1, cv2.LINE_AA, 4)
            views.append(View(name, Detections.none(), odometry=step if k else None, image=image))
        out.append(Tick(k, k / 6, tuple(views)))
    return rovers(), out, Parameters(delay=2)


def street() -> Scene:
    """Two fixed cameras in one place, whose images differ by their noise, and three people."""
    where, rng = Street(), np.random.default_rng(3)
    one, other = where.setup, Street(rng=np.random.default_rng(4))
    mounts = {name: replace(one.mounts[NAME], robot=name) for name in (NAME, "View_002")}
    starts: dict[str, Start | None] = dict.fromkeys(mounts, one.starts[NAME])
    out = []
    for k in range(16):
        people = np.array([[0.0, -3.0 + 0.15 * k], [2.0, 2.0 - 0.1 * k], [-3.0, 0.1 * k]])[: 3 * (k > 4)]
        found = rng.random(len(people)) < 0.7
        views = [replace(place.tick(k, people, found).views[0], camera=name) for name, place in zip(mounts, (where, other), strict=True)]
        out.append(Tick(k, k * one.period, tuple(views)))
    images = ImageParameters(TrackletParameters(), silhouettes=True, appearance=True)
    return replace(one, mounts=mounts, starts=starts), out, Parameters(images=images)


@pytest.mark.parametrize("scene", [robots, street])
def test_threads_change_nothing(scene: Callable[[], Scene]) -> None:
    setup, ticks, parameters = scene()
    found = {n: list(track(setup, ticks, parameters, n)) for n in (1, 2)}
    assert len(found[1]) == len(ticks)
    assert pickle.dumps(found[1]) == pickle.dumps(found[2])
    if scene is robots:
        assert found[1][-1].counters["matched"] > 100
    else:
        assert len(found[1][-1].target_id) == 3


def test_few_ticks_are_in_memory() -> None:
    setup, ticks, parameters = robots()
    read = 0

    def counted() -> Iterator[Tick]:
        nonlocal read
        for tick in ticks:
            read += 1
            yield replace(tick, views=tuple(without_image(view) for view in tick.views))

    estimates = track(setup, counted(), replace(parameters, delay=0), 2)
    for taken, _ in enumerate(estimates, 1):
        assert taken <= read <= taken + 6
    assert read == len(ticks)


def without_image(view: View) -> View:
    return replace(view, image=None)


def test_an_error_comes_in_its_place_and_no_thread_is_left() -> None:
    setup, ticks, parameters = robots()
    ticks = [replace(tick, views=tuple(without_image(view) for view in tick.views)) for tick in ticks]
    before = threading.active_count()
    estimates = track(setup, [*ticks[:3], ticks[1]], replace(parameters, delay=0), 2)
    assert [next(estimates).index for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ValueError, match="tick 1 comes after tick 2"):
        next(estimates)
    stranger = replace(ticks[2], views=(replace(ticks[2].views[0], camera="nobody"),))
    estimates = track(setup, [*ticks[:2], stranger], replace(parameters, delay=0), 2)
    assert [next(estimates).index for _ in range(2)] == [0, 1]
    with pytest.raises(ValueError, match="tick 2 has a view of camera 'nobody', setup has"):
        next(estimates)
    left = track(setup, ticks, parameters, 2)
    assert next(left).index == 0
    left.close()  # type: ignore[attr-defined]
    assert threading.active_count() == before
