"""Intersection over union of upright boxes against closed forms, OpenCV and sampling; yaw along the velocity; HOTA on boxes."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from tracker.formats.aicity.person_boxes import PERSON, boxes_of_tracks, headings
from tracker.geometry import Array
from tracker.metrics.boxes_3d import hota_3d, overlap_3d
from tracker.metrics.matching import MatchingFrame


def box(x: float = 0.0, y: float = 0.0, z: float = 0.0, size: tuple[float, float, float] = (1.0, 1.0, 1.0), yaw: float = 0.0) -> Array:
    return np.array([[x, y, z, *size, yaw]])


def random_boxes(rng: np.random.Generator, n: int) -> Array:
    return np.column_stack([rng.uniform(-1, 1, (n, 3)), rng.uniform(0.2, 2, (n, 3)), rng.uniform(-4, 4, n)])


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (box(), 1.0),
        (box(x=0.25), 0.6),
        (box(x=0.5, y=0.5), 0.25 / 1.75),
        (box(z=0.5), 1 / 3),
        (box(x=1.0), 0.0),
        (box(z=1.0), 0.0),
        (box(x=3.0), 0.0),
        (box(size=(0.5, 0.5, 0.5), yaw=0.3), 0.125),
        (box(yaw=np.pi / 2), 1.0),
        # Two squares at 45° share a regular octagon of area 2 (√2 − 1).
        (box(yaw=np.pi / 4), 2 * (np.sqrt(2) - 1) / (2 - 2 * (np.sqrt(2) - 1))),
    ],
)
def test_overlap_has_its_closed_form(other: Array, expected: float) -> None:
    assert overlap_3d(box(), other)[0, 0] == pytest.approx(expected, abs=1e-12)
    assert overlap_3d(other, box())[0, 0] == pytest.approx(expected, abs=1e-12)
    # The same far from the origin, turned.
    turned = np.array([[0.0, -1.0], [1.0, 0.0]])
    moved = []
    for one in (box(), other):
        far = one.copy()
        far[:, :2] = far[:, :2] @ turned.T + 1000.0
        far[:, 6] += np.pi / 2
        moved.append(far)
    assert overlap_3d(*moved)[0, 0] == pytest.approx(expected, abs=1e-9)


def test_footprints_intersect_as_in_opencv() -> None:
    """OpenCV clips convex polygons with float32."""
    rng = np.random.default_rng(0)
    one, other = random_boxes(rng, 40), random_boxes(rng, 50)
    found = overlap_3d(one, other)
    corners = [
        [cv2.boxPoints(((b[0], b[1]), (b[3], b[4]), float(np.rad2deg(b[6])))) for b in boxes.astype(np.float32).tolist()] for boxes in (one, other)
    ]
    checked = 0
    for i, a in enumerate(one):
        for j, b in enumerate(other):
            area = cv2.intersectConvexConvex(corners[0][i], corners[1][j])[0]
            rise = min(a[2] + a[5] / 2, b[2] + b[5] / 2) - max(a[2] - a[5] / 2, b[2] - b[5] / 2)
            shared = area * max(0.0, rise)
            assert found[i, j] == pytest.approx(shared / (a[3:6].prod() + b[3:6].prod() - shared), abs=2e-5)
            checked += shared > 0
    assert checked > 500


def test_yaw_follows_the_displacement_and_stays_while_standing() -> None:
    """Person 1 stands, walks along +y, stands with 5 cm of noise, and walks back; person 2 never moves."""
    path = [(0, 0), (0.05, 0), (0, 0.3), (0.05, 0.32), (0, 0.28), (0, 0.0)]
    tracks = {k: (np.array([1, 2]), np.array([[*path[k], 0.0], [5.0, 5.0, 0.0]])) for k in range(len(path))}
    up = np.pi / 2
    assert_allclose([yaw[0] for yaw in headings(tracks).values()], [up, up, up, up, up, -up], atol=1e-9)
    assert_allclose([yaw[0] for yaw in headings(tracks, online=True).values()], [0, 0, up, up, up, -up], atol=1e-9)
    assert all(yaw[1] == 0 for yaw in headings(tracks).values())


def frames_of(truth: dict[int, Array], estimate: dict[int, Array], counts: list[bool] | None = None) -> list[MatchingFrame]:
    """One true and one estimated track per row of the arrays (people, 3)."""
    ids = {k: (np.arange(len(p)), p) for k, p in truth.items()}, {k: (np.arange(len(p)), p) for k, p in estimate.items()}
    boxes = [boxes_of_tracks(tracks) for tracks in ids]
    kept = None if counts is None else np.array(counts)
    return [MatchingFrame(*boxes[0][k], *boxes[1][k], counts=kept) for k in truth]


def test_hota_counts_the_thresholds_that_the_overlap_reaches() -> None:
    """A track 0.3 m beside a standing person shares a third of the union: it is right at 6 of the 19 thresholds."""
    still = {k: np.zeros((1, 3)) for k in range(5)}
    beside = {k: np.array([[0.3, 0.0, 0.0]]) for k in range(5)}
    assert hota_3d(frames_of(still, still)).hota == 1
    assert hota_3d(frames_of(still, beside)).hota == pytest.approx(6 / 19)
    above = {k: np.array([[0.0, 0.0, PERSON[2]]]) for k in range(5)}
    assert hota_3d(frames_of(still, above)).hota == 0


def test_ignored_people_take_their_estimates_with_them() -> None:
    two = {k: np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]]) for k in range(3)}
    far = {k: np.array([[0.0, 0.0, 0.0], [5.7, 0.0, 0.0]]) for k in range(3)}
    assert hota_3d(frames_of(two, far)).hota < 0.6
    # At 0.7 m the boxes do not touch, but the match within 1 m removes the estimate of the person that does not count.
    assert hota_3d(frames_of(two, far, [True, False])).hota == 1
