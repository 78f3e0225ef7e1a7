"""Scores of targets equal those of TrackEval and, where the rules agree, of py-motmetrics."""

from __future__ import annotations

import contextlib
import io
import warnings
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.tracker.matching_frames import random_frames, table
from tracker.metrics.clear_mot import TargetScore, score, score_boxes
from tracker.metrics.matching import Comparison, MatchingFrame, compare, overlap, planar_distance


@pytest.fixture(scope="module")
def trackeval() -> dict[str, Any]:
    """TrackEval's metrics, silent; its euclidean similarity is 1 − d / 2 m, its threshold ½ our gate of 1 m."""
    with contextlib.redirect_stdout(io.StringIO()):
        metrics = pytest.importorskip("trackeval").metrics
        quiet = {"PRINT_CONFIG": False}
        return {"CLEAR": metrics.CLEAR(quiet), "Identity": metrics.Identity(quiet), "HOTA": metrics.HOTA()}


def by_trackeval(metrics: dict[str, Any], comparison: Comparison) -> dict[str, Any]:
    lengths = comparison.lengths()
    sequence = {
        "gt_ids": [f.truth for f in comparison.frames],
        "tracker_ids": [f.estimate for f in comparison.frames],
        "similarity_scores": [f.value for f in comparison.frames],
        "num_gt_dets": int(lengths[0].sum()),
        "num_tracker_dets": int(lengths[1].sum()),
        "num_gt_ids": comparison.truths,
        "num_tracker_ids": comparison.estimates,
        "num_timesteps": len(comparison.frames),
    }
    with contextlib.redirect_stdout(io.StringIO()):
        return {name: metric.eval_sequence(sequence) for name, metric in metrics.items()}


def same_as_trackeval(s: TargetScore, peer: dict[str, Any]) -> None:
    clear, identity, hota = peer["CLEAR"], peer["Identity"], peer["HOTA"]
    ours = (s.matches, s.misses, s.false_positives, s.switches, s.fragments, s.mostly_tracked, s.mostly_lost, s.idtp, s.idfp, s.idfn)
    names = ("CLR_TP", "CLR_FN", "CLR_FP", "IDSW", "Frag", "MT", "ML")
    assert ours == (*(clear[n] for n in names), *(identity[n] for n in ("IDTP", "IDFP", "IDFN")))
    if s.truths:
        assert_allclose([s.idf1, s.hota], [identity["IDF1"], hota["HOTA"].mean()], atol=1e-12)
        assert_allclose(s.hota_sums.assa, hota["AssA"], atol=1e-12)
        if s.matches + s.false_positives:
            assert_allclose(s.mota, clear["MOTA"], atol=1e-12)


def test_equal_to_trackeval_on_the_ground(trackeval: dict[str, Any]) -> None:
    rng = np.random.default_rng(6)
    total = TargetScore()
    for _ in range(200):
        frames = random_frames(rng)
        s = score(frames)
        peer = by_trackeval(trackeval, compare(frames, planar_distance).mapped(lambda d: np.maximum(0, 1 - d / 2)))
        same_as_trackeval(s, peer)
        assert_allclose(s.matches - s.distance / 2, peer["CLEAR"]["MOTP_sum"], atol=1e-9)
        total += s
    # The sequences hold what is to be compared.
    assert min(total.switches, total.fragments, total.misses, total.false_positives, total.mostly_lost, total.mostly_tracked) > 100


def test_equal_to_trackeval_on_boxes(trackeval: dict[str, Any]) -> None:
    rng = np.random.default_rng(7)
    for _ in range(60):
        frames = []
        for f in random_frames(rng):
            sizes = [np.tile([2.0, 4.0], (len(ids), 1)) * rng.uniform(0.8, 1.2, (len(ids), 2)) for ids in (f.truth_id, f.estimate_id)]
            frames.append(MatchingFrame(f.truth_id, np.hstack([f.truth, sizes[0]]), f.estimate_id, np.hstack([f.estimate, sizes[1]])))
        s = score_boxes(frames)
        peer = by_trackeval(trackeval, compare(frames, overlap))
        same_as_trackeval(s, peer)
        assert_allclose(s.closeness, peer["CLEAR"]["MOTP_sum"], atol=1e-9)


def test_sequences_merge_as_trackeval_merges_them(trackeval: dict[str, Any]) -> None:
    rng = np.random.default_rng(8)
    sequences = [random_frames(rng) for _ in range(8)]
    peers = [by_trackeval(trackeval, compare(f, planar_distance).mapped(lambda d: np.maximum(0, 1 - d / 2))) for f in sequences]
    s = sum((score(f) for f in sequences), TargetScore())
    merged = {n: m.combine_sequences({str(i): p[n] for i, p in enumerate(peers)}) for n, m in trackeval.items()}
    peer = [merged["CLEAR"]["MOTA"], merged["Identity"]["IDF1"], merged["HOTA"]["HOTA"].mean()]
    assert_allclose([s.mota, s.idf1, s.hota], peer, atol=1e-12)


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
