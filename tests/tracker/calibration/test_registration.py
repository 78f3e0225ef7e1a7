"""Motions of one camera's people into the frame of another one are judged one by one as together, and the right one is best."""

from __future__ import annotations

import numpy as np

from tracker.calibration.registration import Cloud, Paths, agreement, guesses


def walks(seed: int) -> Paths:
    """Ten people who walk for 20 of 80 steps."""
    rng = np.random.default_rng(seed)
    z, here = np.zeros((10, 80), dtype=np.complex128), np.zeros((10, 80))
    for k in range(10):
        begin = int(rng.integers(0, 60))
        step = 0.3 * np.exp(1j * (rng.uniform(-np.pi, np.pi) + np.cumsum(rng.normal(0.0, 0.3, 20))))
        z[k, begin : begin + 20], here[k, begin : begin + 20] = complex(*rng.uniform(-5, 5, 2)) + np.cumsum(step), 1.0
    return Paths(z, here, 5.0 * here, np.arange(10))


def seen_from(paths: Paths, turn: complex, shift: complex, late: int) -> Paths:
    """The same people in another frame, whose clock is `late` steps late."""
    z = (paths.z - shift) / turn * paths.here
    return Paths(np.roll(z, -late, axis=1), np.roll(paths.here, -late, axis=1), paths.range, paths.track)


def test_the_right_motion_is_best_and_motions_are_judged_independently() -> None:
    turn, shift, late = np.exp(0.8j), 3.0 - 2.0j, 4
    first = walks(1)
    second = seen_from(first, turn, shift, late)
    tried = guesses(first, second, 6)[:50]
    a, b = Cloud.of(first), Cloud.of(second)
    z = np.array([g.turn for g in tried])[:, None] * (b.point @ [1, 1j]) + np.array([g.shift for g in tried])[:, None]
    moved, steps = np.stack([z.real, z.imag], axis=2), np.array([g.steps for g in tried])
    seen = np.random.default_rng(2).random(z.shape) < 0.7
    score, share = agreement(a, b, seen, moved, steps)
    for k in range(0, len(tried), 7):
        one = agreement(a, b, seen[k : k + 1], moved[k : k + 1], steps[k : k + 1])
        assert np.allclose([one[0][0], one[1][0]], [score[k], share[k]])
    best = tried[int(np.argmax(score * share))]
    assert best.steps == late
    assert abs(best.turn - turn) < 1e-3
    assert abs(best.shift - shift) < 1e-2
    assert share.max() > 0.9
