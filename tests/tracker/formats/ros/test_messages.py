"""Messages: covariances of joined odometry, calibrations of lenses, markers of those who leave, and obstacles."""

import numpy as np
from numpy.testing import assert_allclose

from tracker.formats.ros.markers import DELETE, boxes_marker, people_markers, person_color, terrain_marker
from tracker.formats.ros.messages import camera_info, composed_covariance, fixed_axes
from tracker.geometry import Pose
from tracker.geometry.cameras import Cylinder, Fisheye
from tracker.geometry.ground import Grid


def test_covariance_of_joined_steps_by_differences() -> None:
    """F is the derivative of the joined pose's error by that of the first pose."""
    rng = np.random.default_rng(3)
    pose, step = Pose.exp(rng.normal(size=6)), Pose.exp(rng.normal(size=6))
    eps = 1e-6
    columns = [((pose @ step).inverse() @ (pose @ Pose.exp(eps * axis) @ step)).log() / eps for axis in np.eye(6)]
    F, A = np.array(columns).T, rng.normal(size=(6, 6))
    P, Q = A @ A.T, np.diag(np.arange(1.0, 7.0))
    assert_allclose(composed_covariance(P, step, Q), F @ P @ F.T + Q, rtol=1e-4, atol=1e-4)


def test_covariance_along_fixed_axes() -> None:
    """A robot that faces +y and errs ahead errs along y."""
    turned = fixed_axes(np.diag([4.0, 1.0, 1.0, 0.1, 0.2, 0.3]), Pose.planar(0, 0, np.pi / 2).rotation)
    assert_allclose(np.diag(turned), [1.0, 4.0, 1.0, 0.2, 0.1, 0.3])


def test_calibrations() -> None:
    fisheye = camera_info(Fisheye(320, 240, 150.0, 151.0, 160.0, 120.0, (0.01, 0.02, 0.03, 0.04)), 0, "c")
    assert (fisheye["distortion_model"], fisheye["d"]) == ("equidistant", [0.01, 0.02, 0.03, 0.04])
    assert fisheye["p"] == [150.0, 0, 160.0, 0, 0, 151.0, 120.0, 0, 0, 0, 1, 0]
    cylinder = Cylinder(400, 60, 30.0, 63.0)
    info = camera_info(cylinder, 0, "c")
    fx, fy, cx, cy = info["d"]
    bearing = cylinder.bearings_from_pixels([[100.5, 20.5]])[0]
    azimuth, slope = np.arctan2(bearing[1], bearing[0]), bearing[2] / np.hypot(bearing[0], bearing[1])
    assert (info["distortion_model"], info["k"]) == ("cylindrical", [0.0] * 9)
    assert_allclose((cx - fx * azimuth, cy - fy * slope), (100, 20), atol=1e-9)


def test_who_leaves_is_removed() -> None:
    markers = people_markers([3], np.array([[1.0, 2.0, 0.5]]), [7], 0)["markers"]
    assert [(m["ns"], m["id"], m.get("action", 0)) for m in markers] == [("people", 3, 0), ("ids", 3, 0), ("people", 7, DELETE), ("ids", 7, DELETE)]
    assert markers[0]["pose"]["position"] == {"x": 1.0, "y": 2.0, "z": 0.5 + 1.75 / 2}


def test_boxes_over_the_seam_are_drawn_on_both_sides() -> None:
    boxes = np.array([[60.0, 10.0, 8.0, 20.0], [5.0, 5.0, 2.0, 4.0]])
    colors = [person_color(1), person_color(2)]
    panorama = boxes_marker(boxes, colors, 64, 0, "c")
    assert sorted({p["x"] for p in panorama["points"]}) == [-4.5, 3.5, 4.5, 6.5, 59.5, 67.5]
    assert panorama["outline_colors"] == [colors[0]] * 16 + [colors[1]] * 8
    assert sorted({p["x"] for p in boxes_marker(boxes, colors, np.inf, 0, "c")["points"]}) == [4.5, 6.5, 59.5, 67.5]


def test_obstacles_are_what_stands_above_the_ground() -> None:
    ground = Grid(np.zeros((6, 8)), np.zeros(2), 0.5)
    heights = np.zeros((6, 8))
    heights[2, 3] = 1.0
    tops = Grid(heights, np.zeros(2), 0.5)
    assert terrain_marker(ground, "obstacles", 0, above=ground) is None
    marker = terrain_marker(tops, "obstacles", 0, above=ground)
    assert marker is not None
    assert len(marker["points"]) == 4 * 2 * 3


def test_a_fine_map_is_thinned() -> None:
    marker = terrain_marker(Grid(np.zeros((301, 202)), np.zeros(2), 0.1), "terrain", 0)
    assert marker is not None
    x, y = (np.array([p[axis] for p in marker["points"]]) for axis in "xy")
    assert len(x) <= 3 * 20_000
    assert_allclose((x.min(), x.max(), y.min(), y.max()), (0, 20.1, 0, 30.0))
