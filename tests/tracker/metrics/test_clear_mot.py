"""Scores of targets: hand-made tables with their arithmetic, laws, and equality with TrackEval."""

from __future__ import annotations

import contextlib
import io
import itertools
import math
import time
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.tracker.matching_frames import random_frames, table
from tracker.metrics.clear_mot import TargetScore, score, score_boxes
from tracker.metrics.matching import Comparison, MatchingFrame, Pairing, compare, match_without_memory, overlap, planar_distance

CLEAR_KEYS = ("mota", "motp_m", "motp_percent", "false_positives", "misses", "switches", "fragments", "mostly_tracked", "mostly_lost")
KEYS = [*CLEAR_KEYS, "truths", "idf1", "hota", "moda", "modp"]


# --- hand-made tables -----------------------------------------------------------------------------------------------------------------


def test_perfect_tracking_scores_one() -> None:
    s = score(table({"p": "AAAA", "q": "BB.B"}, {"x": "AAAA", "y": "BB.B"}))
    assert (s.matches, s.misses, s.false_positives, s.switches) == (7, 0, 0, 0)
    assert s.mota == s.idf1 == s.moda == s.modp == 1
    assert_allclose(s.hota, 1)
    assert (s.motp_m, s.motp_percent, s.mostly_tracked, s.mostly_lost, s.trajectories) == (0, 100, 2, 0, 2)


# --- ignored people ---------------------------------------------------------------------------------------------------------------


def test_an_estimate_matched_to_an_ignored_person_is_dropped() -> None:
    # q is ignored throughout: its misses and the estimate y upon it cost and earn nothing. Left: p 4 frames, x 3 of them, z false once.
    # MOTA = 1 − (1 miss + 1 false positive) / 4. IDTP 3, IDFP 1, IDFN 1: IDF1 = 6 / 8.
    truth, estimates = {"p": "AAAA", "q": "BBBB"}, {"x": "AAA.", "y": "bb..", "z": "...C"}
    s = score(table(truth, estimates, {"q": "0000"}))
    assert (s.truths, s.matches, s.misses, s.false_positives, s.trajectories) == (4, 3, 1, 1, 1)
    assert_allclose([s.mota, s.idf1], [0.5, 0.75])
    # Over everybody: truths 8, matches 5, misses 3, z false: MOTA = 1 − 4 / 8.
    assert_allclose(score(table(truth, estimates)).mota, 0.5)
    assert score(table(truth, estimates)).truths == 8


def test_an_estimate_keeps_its_evaluated_person_beside_an_ignored_one() -> None:
    # q, ignored, stands where x is from the second frame on, p 0.4 m beside. x followed p before: it stays p's, nothing is dropped.
    s = score(table({"p": "aaa", "q": ".AA"}, {"x": "aAA"}, {"q": "000"}))
    assert (s.matches, s.misses, s.false_positives, s.switches) == (3, 0, 0, 0)
    # Without that past the nearer of the two is its match: q. It is dropped, and p is missed.
    s = score(table({"p": "aa", "q": "AA"}, {"x": "AA"}, {"q": "00"}))
    assert (s.matches, s.misses, s.false_positives) == (0, 2, 0)


def test_only_one_estimate_is_dropped_for_each_ignored_person() -> None:
    s = score(table({"p": "AA"}, {"x": "AA", "y": "aa"}, {"p": "00"}))
    assert (s.truths, s.matches, s.false_positives) == (0, 0, 2)
    assert math.isnan(s.mota)


def test_a_person_is_evaluated_in_some_frames_only() -> None:
    # p counts in frames 0, 1, 4: followed there by x, x, y: one switch of three truths, MOTA = 1 − 1/3, and y's frames 2, 3 are dropped.
    s = score(table({"p": "AAAAA", "q": "BBBBB"}, {"x": "AA...", "y": "..AAA", "z": "BBBBB"}, {"p": "11001"}))
    assert (s.truths, s.matches, s.switches, s.false_positives, s.misses) == (8, 8, 1, 0, 0)
    assert_allclose(s.mota, 1 - 1 / 8)


# --- laws -------------------------------------------------------------------------------------------------------------------------


def same(a: TargetScore, b: TargetScore) -> None:
    for name in KEYS:
        assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-12, err_msg=name)


def test_scores_do_not_depend_on_the_order_of_rows_or_the_names_of_ids() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        frames = random_frames(rng)
        shuffled = []
        for f in frames:
            i, j = rng.permutation(len(f.truth_id)), rng.permutation(len(f.estimate_id))
            shuffled.append(MatchingFrame(f.truth_id[i], f.truth[i], 1000 - f.estimate_id[j], f.estimate[j]))
        same(score(shuffled), score(frames))


def test_an_ignored_person_far_from_all_changes_nothing() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        frames = random_frames(rng)
        crowded = [
            MatchingFrame(
                np.append(f.truth_id, 99),
                np.concatenate([f.truth, [[500.0, 0.0]]]),
                np.append(f.estimate_id, 9999),
                np.concatenate([f.estimate, [[500.3, 0.0]]]),
                np.append(np.ones(len(f.truth_id), dtype=bool), False),
            )
            for f in frames
        ]
        same(score(crowded), score(frames))


def test_what_is_outside_of_an_area_is_ignored() -> None:
    """Outside are a person with a track, a person without, and two tracks of nobody; a track outside of a person inside is a match."""
    area = np.array([[0.0, 0.0], [10.0, 5.0]])
    truth = np.array([[0.2, 1.0], [5.0, 2.0], [-3.0, 1.0], [5.0, 7.0]])
    estimate = np.array([[-0.1, 1.0], [5.1, 2.0], [-3.0, 1.2], [-8.0, 1.0], [12.0, 2.0], [9.0, 4.0]])
    frame = MatchingFrame([1, 2, 3, 4], truth, [1, 2, 3, 4, 5, 6], estimate)
    found = score([frame.within(area)])
    assert (found.truths, found.matches, found.misses, found.false_positives) == (2, 2, 0, 1)
    assert score([frame]).false_positives == 3
    unseen = MatchingFrame(frame.truth_id, truth, frame.estimate_id, estimate, counts=[True, False, True, True])
    found = score([unseen.within(area)])
    assert (found.truths, found.matches, found.false_positives) == (1, 1, 1)


def test_matching_without_memory_against_brute_force() -> None:
    rng = np.random.default_rng(4)
    for _ in range(200):
        m, k = (int(n) for n in rng.integers(0, 5, 2))
        value = rng.uniform(-1, 1, (m, k))
        best = (0, 0.0)
        small, large = (value, k) if m <= k else (value.T, m)
        for columns in itertools.permutations(range(large), min(m, k)):
            for used in itertools.product([False, True], repeat=min(m, k)):
                pairs = [small[i, c] for i, (c, u) in enumerate(zip(columns, used, strict=True)) if u]
                if all(v >= 0 for v in pairs):
                    best = max(best, (len(pairs), sum(pairs)))
        found = match_without_memory(Comparison((Pairing(np.arange(m), np.arange(k), value),), m, k), 0.0)
        assert found[0] == best[0]
        assert_allclose(found[1], best[1], atol=1e-12)


# --- the edges --------------------------------------------------------------------------------------------------------------------


def test_nothing_at_all_is_undefined() -> None:
    for frames in ([], table({"p": "..."}, {"x": "..."})):
        s = score(frames)
        assert all(math.isnan(v) for v in (s.mota, s.motp_m, s.motp_percent, s.idf1, s.hota, s.moda, s.modp))
        assert s.truths == s.false_positives == s.mostly_lost == 0
    assert score([]) == TargetScore()


def test_an_id_twice_in_a_frame_is_an_error() -> None:
    one, two = MatchingFrame([1], [[0.0, 0]], [4], [[0.0, 0]]), [[0.0, 0], [5, 5]]
    with pytest.raises(ValueError, match="frame 1 holds truth id 3 twice"):
        score([one, MatchingFrame([3, 3], two, [], [])])
    with pytest.raises(ValueError, match="frame 2 holds estimate id 7 twice"):
        score([one, one, MatchingFrame([], [], [7, 7], two)])


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (([1], [[np.nan, 0]], [], []), "truth holds NaN"),
        (([1], [[np.inf, 0]], [], []), "finite"),
        (([1], [[0.0, 0], [1, 1]], [], []), "truth has shape"),
        (([], [], [1], [[0.0]]), "at least 2 columns"),
        (([1], [[0.0, 0]], [], [], [True, False]), "counts has shape"),
        (([[1]], [[0.0, 0]], [], []), "truth_id has shape"),
    ],
)
def test_frames_are_checked(arguments: tuple[Any, ...], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        MatchingFrame(*arguments)


def test_boxes_are_checked() -> None:
    with pytest.raises(ValueError, match=r"iou is 1\.5"):
        score_boxes([], iou=1.5)
    with pytest.raises(ValueError, match="boxes of shape"):
        score_boxes([MatchingFrame([1], [[0.0, 0]], [1], [[0.0, 0]])])
    with pytest.raises(ValueError, match="sizes of at least 0"):
        score_boxes([MatchingFrame([1], [[0.0, 0, -1, 1]], [1], [[0.0, 0, 1, 1]])])


# --- real data --------------------------------------------------------------------------------------------------------------------


def test_a_crowd_is_scored_fast() -> None:
    rng = np.random.default_rng(5)
    place = rng.uniform(0, 20, (333, 74, 2))
    ids, counts = np.arange(74), rng.random((333, 74)) < 0.8
    frames = [MatchingFrame(ids, p, ids, p + rng.normal(0, 0.4, p.shape), c) for p, c in zip(place, counts, strict=True)]
    begin = time.process_time()
    score(frames)
    assert time.process_time() - begin < 5


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
