"""The person detector with a real network whose answers are known: places, levels of scale, the seam, and pictures of every kind."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.tracker.person_detector.blob_network import BLOB, HEIGHT, META, WIDTH, picture_with, write_blob_network
from tracker.geometry import angles_from_bearing
from tracker.geometry.cameras import Panorama, Pinhole
from tracker.geometry.ground import Flat
from tracker.geometry.image_boxes import box_overlaps
from tracker.person_detector.detector import TRACKED, CameraPlace, PersonDetector, could_stand
from tracker.person_detector.found_boxes import FoundBoxes, one_for_each
from tracker.person_detector.magnification import LARGEST_SHARE, magnified_parts
from tracker.person_detector.network import PersonNetwork
from tracker.recordings import RecordingCamera


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> PersonDetector:
    return PersonDetector(write_blob_network(tmp_path_factory.mktemp("model") / "blobs.onnx"))


def middles(found: FoundBoxes) -> NDArray[np.float64]:
    return found.box[:, :2] + found.box[:, 2:] / 2


def test_boxes_lie_about_the_blobs(detector: PersonDetector) -> None:
    places = [(102.0, 82.0), (50.0, 126.0), (150.0, 134.0)]
    found = detector.find(picture_with((200, 230), places))
    np.testing.assert_allclose(sorted(middles(found).tolist()), sorted(places), atol=1e-3)
    np.testing.assert_allclose(found.box[:, 2:], [[WIDTH, HEIGHT]] * 3, atol=1e-3)
    # 10 · (1 − 0) − 5 is a logit of 5, beyond the last corner of the calibration.
    np.testing.assert_allclose(found.score, 1.0)


def test_large_bodies_come_from_half_the_size(detector: PersonDetector) -> None:
    found = detector.find(picture_with((256, 320), [(164.0, 132.0)], 2 * BLOB))
    large = found.box[found.box[:, 3] > 1.5 * HEIGHT]
    np.testing.assert_allclose(large, [[164 - WIDTH, 132 - HEIGHT, 2 * WIDTH, 2 * HEIGHT]], atol=1e-3)


def test_small_bodies_come_from_parts_at_twice_the_size(tmp_path: Path) -> None:
    """A blob of 8 px is uncertain at full size and sure at twice the size, where its box is half as large; one on the seam, too."""
    small = PersonDetector(write_blob_network(tmp_path / "m.onnx", height=40))
    places = [(0.0, 70.0), (102.0, 82.0), (300.0, 126.0)]
    found = small.find(picture_with((256, 512), places, 8), wraps=True)
    assert len(found) == 3
    order = np.argsort((found.box[:, 0] + WIDTH) % 512)
    for box, place in zip(found.box[order], np.array(places), strict=True):
        np.testing.assert_allclose(box[2:], [WIDTH / 2, 20], atol=1e-3)
        away = (box[:2] + box[2:] / 2 - place + [256, 0]) % [512, 256] - [256, 0]
        np.testing.assert_allclose(away, 0, atol=1.01)


def test_magnified_parts_are_bounded_and_hold_their_peaks() -> None:
    rng = np.random.default_rng(2)
    box = np.column_stack([rng.uniform(0, 500, 80), rng.uniform(0, 230, 80), np.full(80, 8.0), rng.uniform(15, 80, 80)])
    peaks = FoundBoxes(box, rng.uniform(-4, 3, 80))
    parts = magnified_parts(peaks, (256, 512, 3), wraps=False)
    assert parts == magnified_parts(peaks.select(rng.permutation(80)), (256, 512, 3), wraps=False)
    assert 0 < sum(part.area for part in parts) <= LARGEST_SHARE * 256 * 512
    assert parts[0].holds(peaks.select(np.array([np.argmax(peaks.score)]))).all()
    assert not magnified_parts(peaks.select(np.zeros(0, dtype=int)), (256, 512, 3), wraps=True)


def test_scores_follow_the_calibration(tmp_path: Path) -> None:
    image = picture_with((96, 96), [(46.0, 46.0)]) // 255 * 153  # a brightness of 0.6: a logit of 1
    for corners, wanted in (([[-4, 0.0], [0, 0.5], [4, 1.0]], 0.625), ([[-1, 0.0], [0, 0.4], [2, 0.6]], 0.5)):
        model = PersonDetector(write_blob_network(tmp_path / "m.onnx", {"calibration": corners}))
        np.testing.assert_allclose(model.find(image).score, [wanted], atol=1e-5)
    assert not len(PersonDetector(write_blob_network(tmp_path / "m.onnx", {"min_score": 0.7})).find(image))


def test_improbable_boxes_are_found_and_not_tracked(tmp_path: Path) -> None:
    image, camera = picture_with((200, 230), [(102.0, 82.0)]), Pinhole(width=230, height=200, fx=400, fy=400, cx=115, cy=100)
    for probability, tracked in ((TRACKED - 0.01, 0), (TRACKED + 0.01, 1)):
        meta = {"min_score": 0.05, "calibration": [[-4, 0.0], [0, probability / 2], [4, probability]]}
        model = PersonDetector(write_blob_network(tmp_path / "m.onnx", meta))
        assert len(model.find(image, CameraPlace(camera))) == 1
        assert len(model.detections(image, CameraPlace(camera))) == tracked


def test_a_person_across_the_seam_is_one_box(detector: PersonDetector) -> None:
    camera = Panorama(512, 256)
    for column in (0.0, 2.0, 6.0, 250.0, 506.0, 510.0):
        found = detector.find(picture_with((256, 512), [(column, 126.0)]), CameraPlace(camera))
        assert len(found) == 1
        assert 0 <= found.box[0, 0] < 512
        away = (middles(found)[0, 0] - column + 256) % 512 - 256
        assert abs(away) <= 2
        (bearing,) = detector.detections(picture_with((256, 512), [(column, 126.0)]), CameraPlace(camera)).bearing
        azimuth = angles_from_bearing(bearing[None])[0]
        assert abs(np.angle(np.exp(1j * (azimuth - np.pi + 2 * np.pi * column / 512)))) < 0.03
    # Without a seam, both halves are cut at the edges of the picture.
    assert (detector.find(picture_with((256, 512), [(6.0, 126.0)])).box[:, 0] >= 0).all()


def test_a_turned_panorama_has_turned_boxes(detector: PersonDetector) -> None:
    image = picture_with((256, 512), [(34.0, 100.0), (66.0, 142.0), (302.0, 126.0)])
    found = detector.find(image, wraps=True)
    for turn in (64, 256, 480):
        turned = detector.find(np.roll(image, turn, axis=1), wraps=True)
        np.testing.assert_allclose(sorted((turned.box[:, 0] - turn) % 512), sorted(found.box[:, 0]), atol=1e-3)


def test_pictures_of_every_kind(detector: PersonDetector) -> None:
    image = picture_with((96, 128), [(62.0, 46.0)])
    wanted = detector.find(image).box
    assert len(wanted) == 1
    grey = image[:, :, 0]
    alpha = np.concatenate([image, grey[:, :, None]], axis=2)
    for other in (grey, grey[:, :, None], alpha, image.astype(np.uint16) * 257, image[:, ::-1][:, ::-1]):
        np.testing.assert_array_equal(detector.find(other).box, wanted)
    assert not len(detector.find(np.zeros((1, 1, 3), np.uint8)))
    assert not len(detector.find(np.zeros((1, 1, 3), np.uint8), wraps=True))
    for bad in (np.zeros((30_000, 1200), np.uint8), np.zeros((4, 4), np.float64), np.zeros((4, 4, 2), np.uint8), np.zeros((0, 4, 3), np.uint8)):
        with pytest.raises(ValueError, match="picture is"):
            detector.find(bad)


def test_the_shipped_network_is_of_whole_numbers() -> None:
    """Its convolutions are in 8 bits, so that the number of threads changes no box."""
    network, threaded = PersonNetwork(), PersonNetwork(threads=2)
    assert network.path.stat().st_size < 1 << 20
    image = np.random.default_rng(0).random((1, 3, 96, 128), dtype=np.float32)
    for name, values in network(image).items():
        np.testing.assert_array_equal(values, threaded(image)[name], err_msg=name)


def test_a_picture_of_another_size_than_the_camera_is_refused(detector: PersonDetector) -> None:
    with pytest.raises(ValueError, match="image is 192 x 160 px, its camera 180 x 160"):
        detector.find(np.zeros((160, 192, 3), np.uint8), CameraPlace(Pinhole(180, 160, 100.0, 100.0, 90.0, 80.0)))


def test_spread_becomes_the_covariance_of_detections(tmp_path: Path) -> None:
    model = PersonDetector(write_blob_network(tmp_path / "m.onnx", spread=0.1))
    camera = Pinhole(width=320, height=256, fx=400, fy=400, cx=160, cy=128)
    image = picture_with((256, 320), [(162.0, 106.0)])
    found = model.find(image, CameraPlace(camera))
    np.testing.assert_allclose(found.sigma, [[np.sqrt(2) * 0.1 * HEIGHT] * 4], rtol=1e-5)
    covariance = model.detections(image, CameraPlace(camera)).covariance[0]
    assert covariance[1, 1] == pytest.approx((np.sqrt(2) * 0.1 * HEIGHT / 400) ** 2, rel=0.03)
    assert covariance[0, 0] == pytest.approx(covariance[1, 1] / 2, rel=0.03)


def test_suppression_lets_people_overlap() -> None:
    box = np.array([[100, 100, 40, 100], [103, 101, 40, 100], [120, 100, 40, 100], [100, 160, 40, 100]], dtype=float)
    found = one_for_each(FoundBoxes(box, np.array([0.9, 0.8, 0.7, 0.6])), 0.5)
    np.testing.assert_array_equal(found.box, box[[0, 2, 3]])


def test_suppression_does_not_depend_on_the_order_and_wraps() -> None:
    rng = np.random.default_rng(3)
    box = np.column_stack([rng.uniform(0, 400, 60), rng.uniform(0, 100, 60), rng.uniform(20, 60, 60), rng.uniform(50, 150, 60)])
    probability = rng.permutation(60) / 60
    order = rng.permutation(60)
    one, other = (one_for_each(FoundBoxes(box[o], probability[o]), 0.4, 400.0) for o in (np.arange(60), order))
    np.testing.assert_array_equal(one.box, other.box)
    moved = one_for_each(FoundBoxes(np.column_stack([(box[:, 0] + 390) % 400, box[:, 1:]]), probability), 0.4, 400.0)
    np.testing.assert_allclose(moved.box[:, 0], (one.box[:, 0] + 390) % 400)
    edges = np.column_stack([one.box[:, :2], one.box[:, :2] + one.box[:, 2:]])
    assert (box_overlaps(edges, edges, 400.0) - np.eye(len(edges)) <= 0.4).all()


def test_only_boxes_of_a_possible_stature_stand_on_the_ground() -> None:
    lens = Pinhole(width=768, height=576, fx=900, fy=900, cx=384, cy=288)
    camera = RecordingCamera.looking_at(lens, position=(0, 0, 4), target=(12, 0, 0.5))
    tall = {0.4: False, 0.7: False, 1.2: True, 1.7: True, 2.2: True, 3.2: False, 5.0: False}
    for height, wanted in tall.items():
        for place in ((8.0, 0.5), (14.0, -2.0), (20.0, 3.0)):
            feet, head = (camera.pose.inverse().apply(np.array([[*place, z]])) for z in (0.0, height))
            pixels = np.concatenate([lens.pixels_from_bearings(p / np.linalg.norm(p))[0] for p in (feet, head)])
            size = pixels[0, 1] - pixels[1, 1]
            box = np.array([[pixels[0, 0] - 0.2 * size, pixels[1, 1], 0.4 * size, size]])
            if (box[:, 1] < 2).any():
                continue  # beyond the upper edge
            found = FoundBoxes(box, np.ones(1), np.full((1, 4), 0.5))
            assert could_stand(found, lens, camera.pose, Flat())[0] == wanted, (height, place)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"meta": ""}, "no metadata"),
        ({"meta": "[1"}, "metadata 'pilsim'"),
        ({"meta": json.dumps(META | {"version": 2})}, "version is 2"),
        ({"meta": {"calibration": [[0, 0.5], [0, 0.6]]}}, "logits growing"),
        ({"meta": {"calibration": [[0, 0.5], [1, 1.5]]}}, "needs 0 to 1"),
        ({"meta": {"min_score": 2}}, "min_score is 2"),
        ({"meta": "{}"}, "KeyError"),
        ({"outputs": ("heat", "edges")}, "no person detector"),
    ],
)
def test_other_models_are_refused_in_one_line(tmp_path: Path, change: dict, message: str) -> None:  # type: ignore[type-arg]
    path = write_blob_network(tmp_path / "m.onnx", **change)
    with pytest.raises(ValueError, match=message) as caught:
        PersonNetwork(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_no_model_is_refused_in_one_line(tmp_path: Path) -> None:
    whole = write_blob_network(tmp_path / "whole.onnx").read_bytes()
    for content in (b"", b"no model", whole[: len(whole) // 2], np.random.default_rng(0).bytes(4000)):
        path = tmp_path / "m.onnx"
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"m\.onnx") as caught:
            PersonNetwork(path)
        assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="no such model file"):
        PersonNetwork(tmp_path / "absent.onnx")


def test_fuzzed_models_are_refused_in_one_line_or_run(tmp_path: Path) -> None:
    """Bytes of a model that are changed, cut out or repeated: nothing but a ValueError of one line, or a network with maps of the right shape."""
    whole = write_blob_network(tmp_path / "whole.onnx").read_bytes()
    rng, path, refused = np.random.default_rng(5), tmp_path / "m.onnx", list[str]()
    for k in range(150):
        content = bytearray(whole)
        for at in rng.integers(0, len(whole), 1 + k % 8):
            content[at] = rng.integers(256)
        first, last = sorted(rng.integers(0, len(whole), 2))
        if k % 3 == 1:
            del content[first:last]
        elif k % 3 == 2:
            content[first:first] = content[first : min(last, first + 64)]
        path.write_bytes(bytes(content))
        try:
            maps = PersonNetwork(path)(np.zeros((1, 3, 64, 96), dtype=np.float32))
        except ValueError as error:
            refused.append(str(error))
        else:
            assert {name: values.shape for name, values in maps.items()} == {"scores": (1, 16, 24), "edges": (4, 16, 24)}
    assert 40 < len(refused) < 150
    assert all(str(path) in message and "\n" not in message for message in refused)


@pytest.mark.command
def test_a_missing_onnxruntime_is_one_line(tmp_path: Path) -> None:
    """A folder before the installed packages has a file of that name that cannot be imported, as where it is not installed."""
    (tmp_path / "onnxruntime.py").write_text("raise ImportError('none here')\n")
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((8, 8, 3), np.uint8))
    model = write_blob_network(tmp_path / "m.onnx")
    words = [sys.executable, "-m", "pilsim", "detect", str(tmp_path / "a.png"), "--model", str(model), "--out", str(tmp_path / "out")]
    path = os.pathsep.join([str(tmp_path), str(Path(__file__).parents[3])])
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": path})
    assert done.returncode == 2
    assert f"{model}: needs onnxruntime to run, which is missing; `pip install onnxruntime` installs it" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
