"""Each error has one cause, and there are as many errors as the score counts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.scenario import Scenario
from sim.stress.error_causes import CAUSES, FrameEvidence, Mistake, TrialEvidence, count_causes, find_mistakes, gather_evidence
from sim.stress.runner import trial_scores
from sim.stress.sweeps import Case, Faults, default_scenario, recording_cases
from sim.stress.tracker_under_test import TrackerUnderTest
from sim.stress.trial_data import simulate_case
from tests.tracker.recordings.test_folder import small
from tracker.recordings.folder import write_recording


def frame(index: int, **changes: object) -> FrameEvidence:
    """Person 1 at the origin and person 2 three metres away, matched to tracks 11 and 12."""
    plain: dict[str, object] = {
        "index": index,
        "person": np.array([1, 2]),
        "feet": np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]),
        "visible": np.array([1.0, 1.0]),
        "detected": frozenset({1, 2}),
        "shift": {1: 0.0, 2: 0.0},
        "missed": frozenset(),
        "match": {1: 11, 2: 12},
        "track": np.array([11, 12]),
        "place": np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]),
        "false": frozenset(),
    }
    return FrameEvidence(**(plain | changes))  # type: ignore[arg-type]


def missed(index: int, **changes: object) -> FrameEvidence:
    """As `frame`, with person 1 missed and track 11 deleted."""
    plain: dict[str, object] = {"missed": frozenset({1}), "match": {2: 12}, "track": np.array([12]), "place": np.array([[3.0, 0.0, 0.0]])}
    return frame(index, **(plain | changes))


def found(*frames: FrameEvidence) -> list[tuple[int, str, str]]:
    return [(m.frame, m.kind, m.cause) for m in find_mistakes(TrialEvidence(frames, 1 / 6))]


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"visible": np.array([0.0, 1.0]), "detected": frozenset({2})}, "nobody saw it"),
        ({"visible": np.array([0.1, 1.0]), "detected": frozenset({2})}, "occluded"),
        ({"detected": frozenset({2})}, "detector missed"),
        ({"shift": {1: 0.8, 2: 0.0}}, "pose error"),
        ({"place": np.array([[0.7, 0.0, 0.0]])}, "merged"),
        ({}, "gated out"),
    ],
)
def test_causes_of_misses(changes: dict[str, object], cause: str) -> None:
    assert found(frame(0), missed(1, **changes)) == [(1, "miss", cause)]


def test_a_person_who_was_never_tracked_is_not_yet_confirmed() -> None:
    assert found(missed(0)) == [(0, "miss", "not yet confirmed")]


def false(place: float, track: int = 13, **changes: object) -> FrameEvidence:
    """As `frame` with one more track, `place` m along x."""
    here = {"track": np.array([11, 12, track]), "place": np.array([[0.0, 0, 0], [3.0, 0, 0], [place, 0, 0]]), "false": frozenset({track})}
    return frame(1, **(here | changes))


def test_causes_of_false_positives() -> None:
    assert found(frame(0), false(0.8)) == [(1, "false positive", "duplicate")]
    assert found(frame(0), false(9.0)) == [(1, "false positive", "clutter")]
    gone = {"missed": frozenset({1}), "match": {2: 12}, "track": np.array([12, 11])}
    aside = {"place": np.array([[3.0, 0, 0], [-1.5, 0, 0]]), "false": frozenset({11})}
    assert found(frame(0), frame(1, **gone, **aside)) == [(1, "miss", "gated out"), (1, "false positive", "misplaced")]
    moved = aside | {"shift": {1: 1.5, 2: 0.0}}
    assert found(frame(0), frame(1, **gone, **moved)) == [(1, "miss", "pose error"), (1, "false positive", "pose error")]
    left = {"person": np.array([2]), "feet": np.array([[3.0, 0, 0]]), "visible": np.ones(1), "match": {2: 12}, "detected": frozenset({2})}
    assert found(frame(0), frame(1, **left, false=frozenset({11}))) == [(1, "false positive", "coasting")]


def test_causes_of_switches() -> None:
    swapped = frame(1, match={1: 12, 2: 11})
    assert found(frame(0), swapped) == [(1, "switch", "wrong association")] * 2
    new = {"match": {1: 13, 2: 12}, "track": np.array([13, 12])}
    assert found(frame(0), frame(1, **new)) == [(1, "switch", "new track")]
    assert found(frame(0), frame(1, **new, shift={1: 0.9})) == [(1, "switch", "pose error")]
    hidden = missed(1, visible=np.array([0.0, 1.0]), detected=frozenset({2}))
    assert found(frame(0), hidden, frame(2, **new))[-1] == (2, "switch", "after occlusion")
    unseen = missed(1, detected=frozenset({2}))
    assert found(frame(0), unseen, frame(2, **new))[-1] == (2, "switch", "after detector misses")


def test_all_causes_are_listed_with_their_counts() -> None:
    some = [Mistake(0, "miss", "occluded", 1, None, (0.0, 0.0, 0.0))] * 3 + [Mistake(0, "switch", "new track", 1, 2, (0.0, 0.0, 0.0))]
    counts = count_causes(some)
    assert {kind: tuple(causes) for kind, causes in counts.items()} == CAUSES
    assert counts["misses"]["occluded"] == 3
    assert sum(sum(causes.values()) for causes in counts.values()) == 4


def test_nobody_sees_people_in_dropped_views_of_a_recording(tmp_path: Path) -> None:
    write_recording(tmp_path, small())
    (case,) = recording_cases(["recorded_dropout/3"], str(tmp_path), 2, default_scenario(3))
    data = simulate_case(replace(case, faults=Faults(dropout=1.0)), rendered=False)
    evidence = gather_evidence(data, TrackerUnderTest().results_of(data.tracker_setup, data.ticks, "x"))
    assert [frame.visible.tolist() for frame in evidence.frames] == [[0.0, 0.0]] * 3


def test_causes_add_up_to_the_score() -> None:
    """A hard run with many errors of all kinds."""
    scenario = Scenario(seed=1002, robots=1, people=12, frames=14, width=256, misses=0.4, clutter=2.0, bearing_noise=0.015)
    data = simulate_case(Case("x/0", "x", "people", 14, scenario), rendered=False)
    results = TrackerUnderTest().results_of(data.tracker_setup, data.ticks, "x/0/1002")
    scores, counts = trial_scores(data, results), count_causes(find_mistakes(gather_evidence(data, results)))
    for kind, name in (("misses", "misses"), ("false positives", "false_positives"), ("switches", "switches")):
        assert sum(counts[kind].values()) == scores[name]
    assert scores["misses"] > 20
    assert scores["false_positives"] > 0
