"""JRDB export: 2-D labels across the seam, and 3-D labels."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.formats.scene import FRAMES, PEOPLE, positions
from tracker.formats.exported_sequence import RecordedSequence
from tracker.formats.jrdb.export import label_3d
from tracker.formats.jrdb.files import read_labels_2d, read_labels_3d
from tracker.formats.jrdb.reading import CAMERA, read_jrdb
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_boxes, read_views
from tracker.types import KEYPOINT_NAMES

Exported = Callable[[str], Path]
NAME = "plaza-robot_0_camera"


def test_labels_2d_equal_boxes_of_the_sequence(sequence: Path, exported: Exported) -> None:
    path = exported("jrdb") / "labels" / "labels_2d_stitched" / f"{NAME}.json"
    labels, boxes = read_labels_2d(path), read_boxes(sequence)
    assert list(labels) == list(range(FRAMES))
    raw = json.loads(path.read_text())["labels"]
    wraps = 0
    for frame, found in labels.items():
        true = boxes[frame, "robot_0_camera"]
        assert [one.person for one in found] == true.person.tolist()
        assert_array_equal([one.box[:2] for one in found], true.full[:, :2])
        assert_array_equal([one.box[:2] + one.box[2:] for one in found], true.full[:, 2:])
        assert_array_equal([one.seen[:2] + one.seen[2:] for one in found], true.seen[:, 2:])
        assert_allclose([one.visible for one in found], true.visible)
        for entry, edges in zip(raw[f"{frame:06d}.jpg"], true.full, strict=True):
            assert entry["wraps"] == (edges[2] > 256)
            assert 0 <= entry["box"][0] < 256
            wraps += entry["wraps"]
    assert wraps >= 1


def test_labels_3d_have_true_positions_and_headings(sequence: Path, exported: Exported) -> None:
    labels = read_labels_3d(exported("jrdb") / "labels" / "labels_3d" / f"{NAME}.json")
    source, views = read_sequence(sequence), read_views(sequence)
    step = np.diff(positions(), axis=1)[:, -1]
    for truth in source.truth or ():
        T = views[truth.index, "robot_0_camera"].T_world_camera
        for one in labels[truth.index]:
            k = truth.person_id.tolist().index(one.person)
            middle = T.apply(one.centre[None])[0]
            assert np.linalg.norm(middle[:2] - truth.feet[k, :2]) < 0.25
            assert abs(middle[2] - one.size[2] / 2 - truth.feet[k, 2]) < 0.05
            assert 1.5 < one.size[2] < 1.95
            heading = T.rotation @ [np.cos(one.heading), np.sin(one.heading), 0.0]
            way = step[PEOPLE.index(one.person)]
            assert heading[:2] @ way / np.linalg.norm(way) > 0.8


def test_label_3d_bounds_the_key_points() -> None:
    """Somebody at (3, 1) who looks along +y: shoulders 0.4 m apart along x, left one at the lower x; nose at 1.65 m."""
    joints = np.tile([3.0, 1.0, 0.9], (17, 1))
    at = {name: k for k, name in enumerate(KEYPOINT_NAMES)}
    joints[at["left_shoulder"]], joints[at["right_shoulder"]] = [2.8, 1.0, 1.4], [3.2, 1.0, 1.4]
    joints[at["nose"]] = [3.0, 1.1, 1.65]
    box = label_3d(7, joints, np.array([3.0, 1.0, 0.0]))
    assert box.heading == np.pi / 2
    assert_allclose(box.size, [0.1 + 0.2, 0.4 + 0.2, 1.65 / 0.921])
    assert_allclose(box.centre, [3.0, 1.05, 1.65 / 0.921 / 2])


def test_an_export_read_back_has_people_and_detections_in_the_robots_frame(sequence: Path, exported: Exported) -> None:
    original, again = RecordedSequence.open(sequence), read_jrdb(exported("jrdb"))
    camera = original.cameras["robot_0_camera"]
    assert (again.rate, again.frames, again.cameras[CAMERA].camera) == (original.rate, FRAMES, camera)
    for truth in original.truth:
        view = original.views[truth.index, "robot_0_camera"]
        ids, places = (again.truth or {})[truth.index]
        assert ids.tolist() == view.boxes.person.tolist()
        # The camera's frame, lowered to the ground. A label's middle is that of the limbs, which are beside the feet.
        present = truth.person_id.tolist()
        feet = view.T_world_camera.inverse().apply(truth.feet[[present.index(one) for one in ids.tolist()]])
        assert np.linalg.norm(places[:, :2] - feet[:, :2], axis=1).max() < 0.25
        assert_allclose(places[:, 2], feet[:, 2] + again.cameras[CAMERA].pose.translation[2], atol=0.05)
        boxes, confidence = original.detection_boxes(truth.index, "robot_0_camera")
        assert_array_equal(again.detections[CAMERA][truth.index][0], boxes)
        assert_array_equal(again.detections[CAMERA][truth.index][1], confidence)
    assert abs(again.cameras[CAMERA].pose.translation[2] - original.views[0, "robot_0_camera"].T_world_camera.translation[2]) < 0.05
    assert len(list(again.images[CAMERA].images(FRAMES, (camera.height, camera.width)))) == FRAMES
