"""Scores of targets equal those of py-motmetrics where the rules agree, and differ where `clear_mot` says so."""

from __future__ import annotations

import warnings
from types import ModuleType

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.tracker.matching_frames import random_frames, table
from tracker.metrics.clear_mot import score
from tracker.metrics.matching import MatchingFrame, planar_distance


@pytest.fixture(scope="module")
def motmetrics() -> ModuleType:
    pytest.importorskip("pandas")
    return pytest.importorskip("motmetrics")


MOT_METRICS = ["mota", "motp", "num_false_positives", "num_misses", "num_switches", "num_fragmentations", "mostly_tracked", "mostly_lost", "idf1"]


def by_motmetrics(mm: ModuleType, frames: list[MatchingFrame]) -> dict[str, float]:
    events = mm.MOTAccumulator(auto_id=True)
    for f in frames:
        d = planar_distance(f.truth, f.estimate)
        events.update(f.truth_id.tolist(), f.estimate_id.tolist(), np.where(d <= 1, d, np.nan))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return dict(mm.metrics.create().compute(events, metrics=MOT_METRICS, return_dataframe=False))


def one_after_another(sequences: list[list[MatchingFrame]]) -> list[MatchingFrame]:
    """Several sequences as one, with other people in each: the counts of the whole are the sums."""
    return [
        MatchingFrame(f.truth_id + 10000 * i, f.truth, f.estimate_id + 10000 * i, f.estimate) for i, frames in enumerate(sequences) for f in frames
    ]


def test_equal_to_motmetrics_where_the_rules_agree(motmetrics: ModuleType) -> None:
    # People 4 m apart: nobody can be matched in two ways. They have no gaps, and every frame has an estimate: then all of CLEAR agrees
    # but for those who are followed for exactly 0.8 of their frames. 200 sequences, ten at a time.
    rng = np.random.default_rng(9)
    for _ in range(20):
        frames = one_after_another([random_frames(rng, apart=4.0, gaps=False, length=8) for _ in range(10)])
        frames = [f for f in frames if len(f.truth_id)]
        s, peer = score(frames), by_motmetrics(motmetrics, frames)
        tracked = s.mostly_tracked + exactly_four_fifths(frames)
        ours = [s.mota, s.motp_m, s.false_positives, s.misses, s.switches, s.fragments, tracked, s.mostly_lost, s.idf1]
        assert_allclose(ours, [float(peer[name]) for name in MOT_METRICS], atol=1e-12)


def exactly_four_fifths(frames: list[MatchingFrame]) -> int:
    """People followed in exactly 0.8 of their frames, where nobody can be matched in two ways."""
    length: dict[int, int] = {}
    followed: dict[int, int] = {}
    for f in frames:
        near = (planar_distance(f.truth, f.estimate) <= 1).any(axis=1)
        for i, n in zip(f.truth_id.tolist(), near.tolist(), strict=True):
            length[i], followed[i] = length.get(i, 0) + 1, followed.get(i, 0) + n
    return sum(5 * followed[i] == 4 * length[i] for i in length)


def test_identity_is_equal_to_motmetrics_also_in_a_crowd(motmetrics: ModuleType) -> None:
    rng = np.random.default_rng(10)
    for _ in range(5):
        frames = one_after_another([random_frames(rng, length=10) for _ in range(10)])
        assert_allclose(score(frames).idf1, by_motmetrics(motmetrics, frames)["idf1"], atol=1e-12)


@pytest.mark.parametrize(
    ("truth", "x", "y", "name", "ours", "theirs"),
    [
        ("AAAAA", "AAAA.", ".....", "mostly_tracked", 0, 1),  # exactly 0.8
        ("AA.AA", "AA.AA", ".....", "fragments", 1, 0),  # the truth itself was away
        ("AAA", "A.a", "..A", "switches", 1, 0),  # a match of before a gap is kept there, though another estimate is nearer
    ],
)
def test_where_motmetrics_differs(motmetrics: ModuleType, truth: str, x: str, y: str, name: str, ours: int, theirs: int) -> None:
    # A second person keeps every frame busy.
    other = "C" * len(truth)
    frames = table({"p": truth, "q": other}, {"x": x, "y": y, "z": other})
    peer = by_motmetrics(motmetrics, frames)
    here, there = getattr(score(frames), name), peer[{"fragments": "num_fragmentations", "switches": "num_switches"}.get(name, name)]
    # The second person is tracked perfectly: mostly tracked in both.
    base = int(name == "mostly_tracked")
    assert (here - base, there - base) == (ours, theirs)
