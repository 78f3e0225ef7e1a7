"""Tracklets by optical flow: textured people before a textured wall, moved by known steps."""

import cv2
import numpy as np
import pytest

from tracker.detections.optical_flow import KltTracklets, TrackletParameters, TrackOwners, vote_shift
from tracker.geometry import Image, angles_from_bearing, bearing_from_angles
from tracker.geometry.cameras import Camera, Panorama, pinhole
from tracker.types import Detections

SIZE = (400, 800)
CAMERAS: dict[str, Camera] = {"panorama": Panorama(800, 400), "pinhole": pinhole(800, 400, 1.2)}


def texture(seed: int, shape: tuple[int, int]) -> Image:
    rng = np.random.default_rng(seed)
    small = rng.integers(40, 220, (shape[0] // 6 + 2, shape[1] // 6 + 2, 3)).astype(np.uint8)
    return np.asarray(cv2.resize(small, shape[::-1], interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def scene(boxes: list[tuple[int, int, int, int, int]], wall: int = 99) -> Image:
    """Boxes (person, left, top, width, height) px, later ones before earlier ones, around the seam."""
    image = texture(wall, SIZE)
    for person, left, top, width, height in boxes:
        columns = np.arange(left, left + width) % SIZE[1]
        image[top : top + height, columns] = texture(person, (height, width))
    return image


def detections(camera: Camera, boxes: list[tuple[int, int, int, int, int]]) -> Detections:
    n = len(boxes)
    rows = np.array(boxes, dtype=float)[:, 1:]
    middle = np.stack([(rows[:, 0] + rows[:, 2] / 2), rows[:, 1] + rows[:, 3] / 2], axis=1)
    ends = [middle + rows[:, 2:] * [sign / 2, 0] for sign in (-1, 1)] + [middle + rows[:, 2:] * [0, sign / 2] for sign in (-1, 1)]
    wrap = camera.width if isinstance(camera, Panorama) else np.inf
    angles = [angles_from_bearing(camera.bearings_from_pixels(np.stack([e[:, 0] % wrap, e[:, 1]], axis=1))) for e in ends]
    azimuth, elevation = angles_from_bearing(camera.bearings_from_pixels(np.stack([middle[:, 0] % wrap, middle[:, 1]], axis=1)))
    extent = np.stack([(angles[0][0] - angles[1][0]) % (2 * np.pi), angles[2][1] - angles[3][1]], axis=1)
    return Detections(bearing_from_angles(azimuth, elevation), extent, np.ones(n), np.tile(1e-6 * np.eye(2), (n, 1, 1)), np.zeros((n, 0)))


@pytest.mark.parametrize("name", CAMERAS)
def test_links_connect_the_same_person_only(name: str) -> None:
    camera, tracklets = CAMERAS[name], KltTracklets(CAMERAS[name])
    links: tuple[np.ndarray, ...] = ()
    for k in range(4):
        # 1 goes right, 2 goes left, side by side in the end.
        people = [(1, 300 + 9 * k, 150, 40, 110), (2, 420 - 9 * k, 160, 40, 110)]
        links = tracklets.step(scene(people), detections(camera, people))
        assert len(links) == k
        for link in links:
            assert (np.diag(link) > 1).all()
    assert (links[0][[0, 1], [1, 0]] < -2).all()


def test_a_person_crosses_the_seam() -> None:
    camera, tracklets = CAMERAS["panorama"], KltTracklets(CAMERAS["panorama"])
    for k in range(5):
        people = [(1, (760 + 12 * k) % 800, 150, 44, 120)]
        links = tracklets.step(scene(people), detections(camera, people))
        assert all(link[0, 0] > 1 for link in links)
    assert len(links) == 4


def test_corners_of_nearer_people_are_left_out() -> None:
    """Person 2 walks past before person 1, who stands: the box of 1 follows its visible corners."""
    camera, tracklets = CAMERAS["pinhole"], KltTracklets(CAMERAS["pinhole"])
    for k in range(4):
        people = [(1, 400, 150, 60, 110), (2, 340 + 12 * k, 156, 40, 130)]
        links = tracklets.step(scene(people), detections(camera, people))
    assert links[0][0, 0] > 1
    assert links[0][1, 1] > 1
    assert links[0][0, 1] < 0


def test_a_box_without_corners_has_no_link() -> None:
    camera, tracklets = CAMERAS["pinhole"], KltTracklets(CAMERAS["pinhole"])
    people = [(1, 400, 150, 60, 110)]
    grey = np.full((*SIZE, 3), 128, dtype=np.uint8)
    tracklets.step(grey, detections(camera, people))
    assert tracklets.step(grey, detections(camera, people))[0][0, 0] == 0


def test_a_frame_without_an_image_clears_the_state() -> None:
    camera, tracklets = CAMERAS["pinhole"], KltTracklets(CAMERAS["pinhole"])
    people = [(1, 400, 150, 60, 110)]
    tracklets.step(scene(people), detections(camera, people))
    assert tracklets.step(None, detections(camera, people)) == ()
    assert tracklets.step(scene(people), detections(camera, people)) == ()


def test_frames_without_boxes() -> None:
    camera, tracklets = CAMERAS["pinhole"], KltTracklets(CAMERAS["pinhole"])
    people = [(1, 400, 150, 60, 110)]
    tracklets.step(scene(people), Detections.none())
    assert tracklets.step(scene(people), detections(camera, people))[0].shape == (0, 1)
    assert tracklets.step(scene([]), Detections.none())[0].shape == (1, 0)


def test_the_majority_votes() -> None:
    p, rng = TrackletParameters(), np.random.default_rng(3)
    steps = np.concatenate([rng.normal([5, 1], 0.3, (12, 2)), rng.normal([-4, 0], 0.3, (7, 2))])
    shift, agree = vote_shift(steps, 10.0, p)
    assert np.abs(shift - [5, 1]).max() < 0.4
    assert agree[:12].all()
    assert not agree[12:].any()
    still, agree = vote_shift(np.concatenate([np.zeros((10, 2)), steps[:5]]), 10.0, p)
    assert (still == 0).all()
    assert agree.sum() == 10
    assert np.isnan(vote_shift(steps[:3], 10.0, p)[0]).all()
    assert np.isnan(vote_shift(10.0 * np.arange(8)[:, None] * [1, 1] + 1, 10.0, p)[0]).all()


def test_links_of_boxes_become_links_of_tracks() -> None:
    owners = TrackOwners()
    owners.add("a", np.array([7, -1]))
    owners.add("a", np.array([9]))
    links = (np.array([[1.0, 2.0]]), np.array([[3.0, 4.0], [5.0, 6.0]]))
    np.testing.assert_array_equal(owners.links("a", np.array([7, 8, 9]), links, 0.0), [[3, 4], [0, 0], [1, 2]])
    # If the corners may belong to a person before the box, the link is weak evidence.
    np.testing.assert_allclose(owners.links("a", np.array([7]), (np.array([[-9.0]]), np.array([[-9.0], [0.0]])), 0.5), [[np.log(0.5)]], atol=1e-3)
    # The last box of a track counts, not an earlier one.
    owners.add("a", np.array([-1, 7]))
    np.testing.assert_array_equal(owners.links("a", np.array([7]), (np.array([[0.0], [8.0]]), links[0][:, :1], links[1][:, :1]), 0.0), [[8]])
    assert owners.links("b", np.array([7]), links[:1], 0.0).tolist() == [[0, 0]]
