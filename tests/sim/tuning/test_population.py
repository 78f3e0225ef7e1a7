"""The population of synthetic cases: bytes, kinds, scales of confidences, and what a perfect and a blind tracker score."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from sim.tuning.case_file import VERSION, PopulationCase, read_case, write_case
from sim.tuning.detectors import SCALES, ConfidenceScale, drawn_detector
from sim.tuning.kinds import BLOCK, scene
from sim.tuning.look_alikes import NEAR_WALL, LookAlikes
from sim.tuning.population import PopulationKey, case_of, kind_of, population, recorded
from sim.tuning.scoring import evaluate
from sim.tuning.walks import LEAST_SPACING, Habits, Walkers, floor, reached, walks
from tracker.geometry.ground import Grid
from tracker.types import Estimate, Setup, Tick

SEED = 3


def drawn_anew() -> PopulationCase:
    """A case of few frames in a room."""
    return case_of(PopulationKey(5, SEED, "office"), replace(scene("office", np.random.default_rng(SEED)), most_frames=12))


small_case = cache(drawn_anew)


def test_a_case_has_the_same_bytes_whenever_it_is_drawn_and_reads_back(tmp_path: Path) -> None:
    case = small_case()
    for name, one in (("a", case), ("b", drawn_anew())):
        write_case(tmp_path / f"{name}.npz", one)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    read = read_case(tmp_path / "a.npz")
    assert (read.kind, read.delay, read.recording.frames) == (case.kind, case.delay, case.recording.frames)
    for name, frames in case.recording.detections.items():
        for frame, (boxes, confidence) in frames.items():
            np.testing.assert_allclose(read.recording.detections[name][frame][0], boxes, atol=0.006)
            np.testing.assert_allclose(read.recording.detections[name][frame][1], confidence, atol=6e-5)


@pytest.mark.parametrize("wrong", ["version", "content", "number"])
def test_another_file_is_refused_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: str) -> None:
    path = tmp_path / f"case-{SEED}-00000.npz"
    if wrong == "content":
        path.write_bytes(b"PK nothing")
    else:
        with monkeypatch.context() as context:
            context.setattr("sim.tuning.case_file.VERSION", 0 if wrong == "version" else VERSION)
            write_case(path, replace(small_case(), number=7))
    with pytest.raises(ValueError, match=rf"^{path}: is (of version 0|no case|case 7)"):
        population(1, SEED, tmp_path)


def test_each_block_has_all_kinds_in_their_shares() -> None:
    for block in range(3):
        assert Counter(kind_of(len(BLOCK) * block + k, SEED) for k in range(len(BLOCK))) == Counter(BLOCK)


@pytest.mark.parametrize("kind", SCALES)
def test_scales_of_confidence_increase(kind: str) -> None:
    said = ConfidenceScale(kind, 1.7, 0.1).said(np.linspace(0.01, 0.99, 50))
    assert (np.diff(said) == 0).all() if kind in ("one", "none") else (np.diff(said) > 0).all()


def test_people_keep_apart_stay_on_the_floor_and_stand_in_groups() -> None:
    rng = np.random.default_rng(4)
    around = floor(np.array([[0.0, 0.0], [8.0, 4.0]]), np.array([[4.0, 2.0, 0.6, 0.0, 0.7]]), 1, rng)
    walked = walks(Walkers.of(around, Habits(0.9, 0.0, 0.0, 60.0, 1.0, (0.4, 0.5)), (10, 14, 0), 20.0, rng), 80, 0.25)
    nearest = []
    for place in walked.place:
        here = place[np.isfinite(place[:, 0])]
        assert (around.free.clearance_at(here) > -0.15).all()
        gaps = np.linalg.norm(here[:, None] - here, axis=2) + np.diag(np.full(len(here), np.inf))
        assert gaps.min() > 0.6 * LEAST_SPACING
        nearest.append(np.median(gaps.min(axis=1)))
    assert np.mean(nearest) < 0.7
    assert np.isnan(walked.place[0]).any()


def test_who_crosses_walks_steadily_to_a_far_door_and_others_come() -> None:
    """Doors are far from the only place where people meet. As many people come as leave, and hardly anybody is there a minute later."""
    rng = np.random.default_rng(4)
    around = replace(floor(np.array([[0.0, 0.0], [24.0, 12.0]]), np.zeros((0, 5)), 4, rng), spots=np.array([[12.0, 6.0]]))
    walked = walks(Walkers.of(around, Habits(0.5, 0.0, 0.0, 10.0, 1.3, (0.4, 0.5), crossing=1.0), (10, 45, 0), 60.0, rng), 240, 0.25).place
    here = np.isfinite(walked[:, :, 0])
    assert 5 < here.sum(axis=1).mean() < 15
    assert (here[0] & here[-1]).sum() <= 1
    speed = np.linalg.norm(np.diff(walked, axis=0), axis=2) / 0.0625
    assert np.nanmedian(speed) > 1.1


def test_a_wall_of_a_height_map_hides_what_is_behind_it() -> None:
    heights = np.zeros((41, 41))
    heights[:, 20] = 1.2
    wall, eye = Grid(heights, np.array([0.0, 0.0]), 0.25), np.array([1.0, 5.0, 1.5])
    points = np.array([[4.0, 5.0, 0.3], [8.0, 5.0, 0.3], [8.0, 5.0, 1.7]])
    assert reached(wall, eye, points).tolist() == [True, False, True]


def perfect(case: PopulationCase) -> object:
    """A tracker that knows the truth of a case."""

    def follow(setup: Setup, ticks: Iterable[Tick]) -> Iterator[Estimate]:
        starts = {robot: start.T_world_robot for robot, start in setup.starts.items() if start is not None}
        for tick in ticks:
            ids, feet = (case.recording.truth or {})[tick.index]
            yield replace(
                Estimate.of_robots(tick.index, starts, {robot: np.zeros((6, 6)) for robot in starts}, {}),
                target_id=ids,
                position=feet,
                covariance=np.tile(0.01 * np.eye(3), (len(ids), 1, 1)),
            )

    return follow


def test_truth_scores_one_and_silence_nothing() -> None:
    case = small_case()
    best = evaluate(case, perfect(case))  # type: ignore[arg-type]
    assert (best["hota"], best["mota"], best["idf1"]) == pytest.approx((1.0, 1.0, 1.0))
    silent = evaluate(replace(case, recording=replace(case.recording, detections={name: {} for name in case.recording.detections})))
    assert silent["truths"] == best["truths"] == silent["misses"]


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[PopulationCase]]:
    """A block of cases, and its folder."""
    folder = tmp_path_factory.mktemp("block")
    return folder, population(len(BLOCK), SEED, folder)


def people_at_once(case: PopulationCase) -> int:
    return max(len(ids) for ids, _ in (case.recording.truth or {}).values())


@pytest.mark.soak
def test_people_of_all_kinds_are_seen(block: tuple[Path, list[PopulationCase]], tmp_path: Path) -> None:
    """Of a block, people are in view mostly, and numbers of cameras are in bounds. A case does not depend on those before it."""
    folder, cases = block
    (alone,) = population(1, SEED, tmp_path / "alone", first=7)
    for case in cases:
        assert 2 <= len(case.recording.cameras) <= 8
        seen = np.concatenate(list(case.recording.visible.values()))
        assert (seen > 0.2).mean() > 0.3
    name = f"case-{SEED}-{alone.number:05d}.npz"
    assert (folder / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()


@pytest.mark.soak
def test_no_more_people_are_there_at_once_than_the_kinds_say(block: tuple[Path, list[PopulationCase]]) -> None:
    assert max(map(people_at_once, block[1])) <= 60


def test_things_that_look_like_people_stand_in_all_views_and_are_weaker() -> None:
    """With things, the same scene has more boxes, at the same places in all frames; boxes of people are as sure as before."""
    made = replace(scene("office", np.random.default_rng(SEED)), most_frames=30)
    found = next(found for seed in range(20) if len(found := LookAlikes.drawn(made.around, np.random.default_rng(seed))) > 2)
    free = made.around.free
    assert (free.clearance_at(found.place) < NEAR_WALL + free.spacing).all()
    detector = drawn_detector(10.0, np.random.default_rng(1))
    detector = replace(detector, scale=ConfidenceScale("given", 1.0, 0.0))
    walkers = Walkers.of(made.around, made.habits, (made.at_once, made.people, 0), made.frames / made.rate, np.random.default_rng(2))
    walked = walks(walkers, made.frames, 1 / made.rate)

    def boxes(things: LookAlikes) -> np.ndarray:
        recording = recorded(made, walked, [detector] * len(made.cameras), things, np.random.default_rng(5))
        return np.concatenate([confidence for of in recording.detections.values() for _, confidence in of.values()])

    sure = replace(found, found=np.ones(len(found)), weaker=np.full(len(found), 3.0))
    bare, weak = boxes(LookAlikes.none()), boxes(sure)
    assert len(weak) > len(bare) + 0.5 * len(found) * made.frames
    # Most of the new boxes rank among the least sure quarter of people's.
    unsure = float(np.quantile(bare, 0.25))
    assert (weak < unsure).sum() - (bare < unsure).sum() > 0.6 * (len(weak) - len(bare))
