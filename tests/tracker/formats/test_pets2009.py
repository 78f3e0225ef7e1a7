"""PETS 2009: cameras, annotations and detections, with reference numbers from the public files."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker import sequences
from tests.tracker.formats.scene import FRAMES
from tests.tracker.formats.small_sources import write_pets
from tracker.detections.boxes import detections_from_boxes
from tracker.formats.opening import open_sequence
from tracker.formats.pets2009 import PILLARS, Site, ground_truth, read_annotations, read_site, view_names, write_annotations, write_site
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Pose, angles_from_bearing
from tracker.geometry.cameras import Tsai
from tracker.geometry.ground import Flat, Grid
from tracker.io.mot15 import MAX_FRAME, read_detections, read_mot15
from tracker.io.tsai_xml import read_camera, write_camera
from tracker.sequence.reader import read_sequence

# The tracking area of the cropped annotations, m.
AREA = np.array([[-14.0696, -14.2740], [4.9813, 1.7335]])

CAMERA = """<?xml version="1.0" encoding="UTF-8"?>
<Camera name="View_001">
  <Geometry width="768" height="576" ncx="795" nfx="752" dx="4.85e-3" dy="4.65e-3" dpx="5.1273271277e-03" dpy="4.65e-03"/>
  <Intrinsic focal="5.5549183034e+00" kappa1="5.1113043639e-03" cx="3.2422149053e+02" cy="2.8256650051e+02" sx="1.0937855397e+00"/>
  <Extrinsic tx="8.2873214225e+02" ty="-3.1754796051e+03" tz="3.5469298547e+04" rx="2.0405458695" ry="-0.89337703748" rz="-0.43056124791"/>
</Camera>
"""

ANNOTATION = """<?xml version="1.0" encoding="utf-8"?>
<dataset name="PETS">
  <frame number="0">
    <objectlist>
      <object id="9"><box h="80" w="30" xc="500" yc="200"/></object>
      <object id="15"><box h="88.5" w="32.5" xc="274.5" yc="263.25"/></object>
    </objectlist>
  </frame>
  <frame number="1">
    <objectlist>
      <object id="9"><box h="80" w="30" xc="501" yc="200"/></object>
    </objectlist>
  </frame>
  <frame number="2"><objectlist/></frame>
</dataset>
"""


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        path = tmp_path / "file.xml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


# --- cameras ----------------------------------------------------------------------------------------------------------------------


def test_view_001_has_its_golden_numbers(written: Callable[[str], Path]) -> None:
    name, camera, T_world_camera = read_camera(written(CAMERA))
    assert (name, camera.width, camera.height) == ("View_001", 768, 576)
    assert_allclose(T_world_camera.translation, [-28.940, -19.529, 7.066], atol=5e-4)
    pixels, inside = camera.pixels_from_bearings(T_world_camera.inverse().apply([[0, 0, 0], [0, 0, 1.8]]))
    assert inside.all()
    assert_allclose(pixels, [[351.9, 175.8], [349.1, 115.7]], atol=0.05)


@pytest.mark.parametrize("view", [1, 5, 7])
def test_real_cameras_map_pixels_to_bearings_and_back_and_are_written(data: Any, tmp_path: Path, view: int) -> None:
    name, camera, T = read_camera(data("pets2009", "calibration", f"View_00{view}.xml"))
    assert name == f"View_00{view}"
    assert (camera.width, camera.height) == (768 if view <= 4 else 720, 576)
    u, v = np.meshgrid(np.linspace(0, camera.width, 25), np.linspace(0, camera.height, 19))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    inner = (pixels > 0).all(axis=1) & (pixels < [camera.width, camera.height]).all(axis=1)
    if camera.kappa1 < 0:
        # The model folds back at 1/√(−3 κ1) mm, in View_007 alone within the image: its left corners share their directions with pixels within.
        radius = np.hypot((pixels[:, 0] - camera.cx) * camera.dpx / camera.sx, (pixels[:, 1] - camera.cy) * camera.dpy)
        folded = radius > 1 / np.sqrt(-3 * camera.kappa1)
        assert folded.any() == (view == 7)
        assert folded.mean() < 0.02
        pixels, inner = pixels[~folded], inner[~folded]
    again, inside = camera.pixels_from_bearings(camera.bearings_from_pixels(pixels) * 7.0)
    assert_allclose(again, pixels, atol=1e-5)
    assert inside[inner].all()
    assert 1 < T.translation[2] < 10
    write_camera(tmp_path / "c.xml", name, camera, T)
    written = read_camera(tmp_path / "c.xml")
    assert written[:2] == (name, camera)
    assert_allclose(written[2].rotation, T.rotation, atol=1e-12)
    assert_allclose(written[2].translation, T.translation, atol=1e-9)


@pytest.mark.parametrize("azimuth", [0.0, np.pi / 2, np.pi, -np.pi / 2, 1e-9, 1e-7, np.pi - 1e-8, 0.3])
def test_level_cameras_round_trip_at_any_azimuth(written: Callable[[str], Path], tmp_path: Path, azimuth: float) -> None:
    # Along x and −x the middle one of the three angles is a right angle.
    _, camera, _ = read_camera(written(CAMERA))
    T = Pose.planar(3.0, -2.0, azimuth, 1.5)
    write_camera(tmp_path / "c.xml", "a & b", camera, T)
    name, _, again = read_camera(tmp_path / "c.xml")
    assert name == "a & b"
    assert_allclose(again.rotation, T.rotation, atol=1e-12)
    assert_allclose(again.translation, T.translation, atol=1e-9)


def test_distortion_without_inverse_is_refused(written: Callable[[str], Path]) -> None:
    path = written(CAMERA.replace('kappa1="5.1113043639e-03"', 'kappa1="-0.2"'))
    with pytest.raises(ValueError, match="cannot be inverted") as error:
        read_camera(path)
    # The fold is at 1/√0.6 = 1.291 mm, that is 275 px right of the axis and 278 px above it.
    text = str(error.value)
    assert text.startswith(f"{path}:line 4: field Intrinsic.kappa1 is -0.2: beyond 1.29 mm from the axis, from pixel (")
    u, v = (int(number) for number in text.split("from pixel (")[1].split(")")[0].split(", "))
    assert np.hypot((u - 324.22) * 5.127e-3 / 1.0938, (v - 282.57) * 4.65e-3) == pytest.approx(1.291, abs=0.01)
    assert "% of the image, needs at most 1%" in text


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('focal="5.5549183034e+00" ', "", "line 4: field Intrinsic.focal is missing"),
        ('rz="-0.43056124791"', "", "line 5: field Extrinsic.rz is missing"),
        ('kappa1="5.1113043639e-03"', 'kappa1="nan"', "line 4: field Intrinsic.kappa1 is nan, needs a finite number"),
        ('width="768"', 'width="768.5"', "line 3: field Geometry.width is 768.5, needs a whole number"),
        ('width="768"', 'width="0"', "field image size is 0 x 576"),
        ('sx="1.0937855397e+00"', 'sx="-1"', "field sx is -1.0, needs more than 0"),
        (' name="View_001"', "", "line 2: field Camera.name is missing"),
        ("Camera", "Kamera", "field Camera is missing"),
        ("</Camera>", "", "is not XML"),
        ('encoding="UTF-8"', 'encoding="UTF-99"', "is not XML"),
        ('number="1"', 'number="0"', "line 9: field frame.number 0 occurs twice"),
        ('number="1"', 'number="-1"', "line 9: field frame.number -1 is below 0"),
        ('id="15"', 'id="9"', "line 6: field object.id 9 occurs twice in frame 0"),
        ('w="32.5"', 'w="-32.5"', "line 6: field box.w is -32.5, needs more than 0"),
        ('yc="263.25"', "", "line 6: field box.yc is missing"),
        ('<box h="88.5" w="32.5" xc="274.5" yc="263.25"/>', "", "line 6: field box is missing in object"),
    ],
)
def test_errors_name_the_field(written: Callable[[str], Path], old: str, new: str, text: str) -> None:
    whole, read = (CAMERA, read_camera) if old in CAMERA else (ANNOTATION, read_annotations)
    assert old in whole
    path = written(whole.replace(old, new))
    with pytest.raises(ValueError, match=r"field|is not XML") as error:
        read(path)
    assert str(error.value).startswith(f"{path}:")
    assert text in str(error.value)


# --- annotations ------------------------------------------------------------------------------------------------------------------


def test_annotations_are_boxes_by_their_corner(written: Callable[[str], Path]) -> None:
    frames = read_annotations(written(ANNOTATION))
    assert list(frames) == [0, 1, 2]
    assert_array_equal(frames[0][0], [9, 15])
    assert_array_equal(frames[0][1], [[485, 160, 30, 80], [258.25, 219, 32.5, 88.5]])
    assert frames[2][0].shape == (0,)
    assert frames[2][1].shape == (0, 4)


def test_older_spelling_of_centres_is_read(written: Callable[[str], Path]) -> None:
    new = read_annotations(written(ANNOTATION))
    old = read_annotations(written(ANNOTATION.replace("xc=", "x=").replace("yc=", "y=")))
    for k in new:
        assert_array_equal(old[k][1], new[k][1])


def test_feet_projected_along_slanted_rays(written: Callable[[str], Path]) -> None:
    # The feet that a camera sees on the ground are cast back to where they were.
    _, camera, T = read_camera(written(CAMERA))
    feet = np.array([[0.0, 0, 0], [-8, -5, 0], [3, 1, 0]])
    pixels, _ = camera.pixels_from_bearings(T.inverse().apply(feet))
    boxes = np.column_stack([pixels - [10, 60], np.full(3, 20.0), np.full(3, 60.0)])
    found = ground_truth({4: (np.array([1, 2, 3]), boxes)}, camera, T, Flat())
    assert_array_equal(found[4][0], [1, 2, 3])
    assert_allclose(found[4][1], feet, atol=1e-6)


def test_feet_above_the_horizon_are_refused(written: Callable[[str], Path]) -> None:
    _, camera, T = read_camera(written(CAMERA))
    with pytest.raises(ValueError, match="frame 3: the feet of id 8"):
        ground_truth({3: (np.array([8]), np.array([[300.0, -900, 20, 10]]))}, camera, T, Flat())


def truth_in_the_area(data: Any) -> tuple[dict[int, Any], dict[int, Any], Any, Pose]:
    _, camera, T = read_camera(data("pets2009", "calibration", "View_001.xml"))
    whole = read_annotations(data("pets2009", "S2.L1", "annotations", "PETS2009-S2L1.xml"))
    cropped = read_annotations(data("pets2009", "S2.L1", "annotations", "PETS2009-S2L1-cropped.xml"))
    return whole, cropped, camera, T


def test_cropped_annotation_equals_the_tracking_area(data: Any) -> None:
    # The annotators cropped by ground position: with the middle of the box's lower edge, cast by this model, every one of 4650 boxes falls on
    # the side where they have it. One pixel more or less gets a dozen wrong.
    whole, cropped, camera, T = truth_in_the_area(data)
    assert (len(whole), len(cropped), sum(len(ids) for ids, _ in whole.values())) == (795, 795, 4650)
    kept = 0
    for frame, (ids, feet) in ground_truth(whole, camera, T, Flat()).items():
        inside = ((feet[:, :2] >= AREA[0]) & (feet[:, :2] <= AREA[1])).all(axis=1)
        assert inside.sum() == len(cropped[frame][0])
        same = np.abs(whole[frame][1][:, None] - cropped[frame][1][None]).max(axis=2) < 1e-3
        assert_array_equal(same.any(axis=1), inside)
        kept += len(ids[inside])
    assert kept == 3955


def test_positions_of_the_challenge_equal_projected_feet_up_to_rounding(data: Any) -> None:
    # MOT15 has the same boxes rounded to whole pixels, and its x, y are those boxes' feet, rounded down and less 1 pixel.
    whole, _, camera, T = truth_in_the_area(data)
    rows = read_mot15(data("pets2009", "S2.L1", "mot15", "gt.txt"))
    ours = ground_truth(whole, camera, T, Flat())
    apart = []
    for frame, k in rows.by_frame().items():
        ids, feet = ours[frame - 1]
        order = np.argsort(ids)[np.searchsorted(np.sort(ids), rows.id[k])]
        assert_array_equal(ids[order], rows.id[k])
        assert np.abs(whole[frame - 1][1][order] - rows.box[k]).max() < 0.51
        apart.append(np.linalg.norm(feet[order, :2] - rows.position[k, :2], axis=1))
    assert np.median(np.concatenate(apart)) < 0.13
    assert np.concatenate(apart).max() < 0.4
    shown = np.floor(rows.box[:, :2] + rows.box[:, 2:] * [0.5, 1.0]) - 1
    boxes = {1: (rows.id, np.column_stack([shown - [5, 10], np.full((len(rows), 2), 10.0)]))}
    assert_allclose(ground_truth(boxes, camera, T, Flat())[1][1][:, :2], rows.position[:, :2], atol=2e-3)


# --- detections -------------------------------------------------------------------------------------------------------------------


def test_a_detection_without_a_box_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "View_001.txt"
    path.write_text("1,-1,5,6,7,8,0.9,-1,-1,-1\n1,-1,-1,-1,-1,-1,0.5,1,2,0\n")
    with pytest.raises(ValueError, match="frame 1 has a detection without a box"):
        read_detections(path)


@pytest.mark.parametrize("view", [1, 3, 4, 5, 6, 7, 8])
def test_the_real_detections_cover_every_frame(data: Any, view: int) -> None:
    found = read_detections(data("pets2009", "S2.L1", "detections", f"View_00{view}.txt"))
    assert list(found) == list(range(1, 796))
    assert all((boxes[:, 2:] > 0).all() and (confidence >= 0.05).all() for boxes, confidence in found.values())


box = st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(0.01, 1e4), st.floats(0.01, 1e4))
frame = st.dictionaries(st.integers(0, 2**53 - 1), box, max_size=4)


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.integers(0, MAX_FRAME), frame, max_size=5), st.text(st.characters(codec="utf-8", categories=["L", "P"]), max_size=8))
def test_round_trip(frames: dict[int, dict[int, tuple[float, ...]]], name: str) -> None:
    given_ = {k: (np.array(list(f), dtype=np.int64), np.array(list(f.values())).reshape(-1, 4)) for k, f in frames.items()}
    with tempfile.TemporaryDirectory() as folder:
        write_annotations(Path(folder) / "a.xml", name, given_)
        again = read_annotations(Path(folder) / "a.xml")
        assert [p.name for p in Path(folder).iterdir()] == ["a.xml"]
    assert list(again) == sorted(given_)
    for k, (ids, boxes) in again.items():
        assert_array_equal(ids, given_[k][0])
        # The file has centres: half a width is added and taken off.
        assert_allclose(boxes, given_[k][1], rtol=1e-12, atol=1e-11)


def test_frames_count_from_0_and_boxes_are_centred(tmp_path: Path) -> None:
    write_annotations(tmp_path / "a.xml", "x", {0: (np.array([3]), np.array([[10.0, 20, 4, 6]]))})
    text = (tmp_path / "a.xml").read_text()
    assert '<frame number="0">' in text
    assert '<object id="3"><box h="6" w="4" xc="12" yc="23"/></object>' in text


def test_box_of_zero_size_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"frame 4: the box of id 3 is 0.0 x 6.0 px, needs more than 0"):
        write_annotations(tmp_path / "a.xml", "x", {4: (np.array([3]), np.array([[10.0, 20, 0, 6]]))})
    assert not list(tmp_path.iterdir())


def test_elements_that_stand_twice_are_merged_and_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "a.xml"
    one = '<object id="1"><box h="4" w="2" xc="1" yc="2"/></object>'
    frame = '<frame number="0"><objectlist>{}</objectlist></frame>'
    path.write_text(f"<dataset>{frame.format(one + one)}{frame.format(one)}</dataset>")
    ((ids, boxes),) = read_annotations(path).values()
    assert_array_equal(ids, [1])
    assert_array_equal(boxes, [[0, 0, 2, 4]])
    assert caplog.messages == [f"{path}: 2 repeated elements merged"]
    for body, message in (
        (frame.format(one + one.replace('w="2"', 'w="3"')), "object.id 1 occurs twice in frame 0, with two boxes"),
        (frame.format(one) + frame.format(""), "frame.number 0 occurs twice, with other boxes"),
    ):
        path.write_text(f"<dataset>{body}</dataset>")
        with pytest.raises(ValueError, match=message):
            read_annotations(path)


SITE = Site(6.0, np.array([[-5.0, -4.0], [5.0, 4.0]]), Flat(), pillars=np.array([[1.0, 2.0, 0.1, 0.0, 2.5], [1.0, 2.0, 0.3, 2.5, 3.0]]))


def test_pillars_round_trip(tmp_path: Path) -> None:
    write_site(tmp_path, SITE, None)
    site = read_site(tmp_path)
    np.testing.assert_array_equal(site.pillars, SITE.pillars)
    np.testing.assert_array_equal(site.area, SITE.area)


def test_default_pillars(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read_site(tmp_path).pillars, PILLARS)
    (tmp_path / "site.json").write_text(json.dumps({"rate": 7, "area": [[0, 0], [1, 1]], "terrain": None}))
    assert read_site(tmp_path).pillars.shape == (0, 5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pillars": [[1, 2, 0.1, 0]]}, "pillars is .*, needs 1 x 5 numbers .*: rows of x, y, radius, low and high in metres"),
        ({"pillars": [[1, 2, 0, 0, 2]]}, "pillars is .*, needs rows of x, y, radius, low and high in metres"),
        ({"pillars": "x"}, "pillars is 'x', needs"),
        ({"rate": None}, "rate is missing"),
        ({"area": [[0, 0], [0, 1]]}, "area is .*needs two corners"),
        ({"terrain": "../terrain.npz"}, "terrain is '../terrain.npz', needs 'terrain.npz' or null"),
    ],
)
def test_invalid_sites_are_refused(tmp_path: Path, change: dict[str, object], message: str) -> None:
    (tmp_path / "site.json").write_text(json.dumps({"rate": 7, "area": [[0, 0], [1, 1]], "terrain": None} | change))
    with pytest.raises(ValueError, match=rf"site.json: {message}"):
        read_site(tmp_path)


def test_pets(data: Callable[..., Path]) -> None:
    assert len(open_sequence(data("pets2009", "S2.L1")).setup.mounts) == 7
    sequence = open_sequence(data("pets2009", "S2.L1"), SourceOptions(("1", "5", "7")))
    assert list(sequence.setup.mounts) == ["View_001", "View_005", "View_007"]
    assert len(sequence.ticks) == 795
    assert sequence.truth is not None
    assert len(sequence.truth) == 795
    assert sequence.truth[0].person_id.tolist() == [9, 15, 19]


def test_detection_keeps_its_foot_point(data: Callable[..., Path]) -> None:
    """The lower edge of the angular box goes through the middle of the lower edge of the pixel box, to the pixel."""
    sequence = open_sequence(data("pets2009", "S2.L1"), SourceOptions(("View_001",)))
    camera = sequence.setup.mounts["View_001"].camera
    boxes = np.array([[640.0, 240.0, 43.0, 80.0], [100.0, 400.0, 60.0, 150.0]])
    found = detections_from_boxes(camera, boxes, np.ones(2))
    azimuth, elevation = angles_from_bearing(found.bearing)
    low = elevation - found.extent[:, 1] / 2
    foot = np.stack([np.cos(low) * np.cos(azimuth), np.cos(low) * np.sin(azimuth), np.sin(low)], axis=1)
    pixels, inside = camera.pixels_from_bearings(foot)
    assert inside.all()
    np.testing.assert_allclose(pixels, [[661.5, 320.0], [130.0, 550.0]], atol=1e-6)


def test_other_and_degraded_detections(data: Callable[..., Path]) -> None:
    folder, other = data("pets2009", "S2.L1"), data("pets2009", "S2.L1", "mot15", "det.txt")
    choice = SourceOptions.parse([f"1={other}"], "drop=0.5,clutter=1", 3, cameras="1,5")
    assert SourceOptions.of_run(choice.to_run()).degradation == choice.degradation
    worse, again = open_sequence(folder, choice), open_sequence(folder, SourceOptions.of_run(choice.to_run()))
    assert worse.provenance == again.provenance != open_sequence(folder, SourceOptions(("1", "5"))).provenance
    for a, b in zip(list(worse.ticks)[:20], list(again.ticks)[:20], strict=True):
        for v, w in zip(a.views, b.views, strict=True):
            np.testing.assert_array_equal(v.detections.bearing, w.detections.bearing)
    # A view draws from a stream of its own: one more view does not change what another loses.
    alone = open_sequence(folder, SourceOptions.parse((), "drop=0.5,clutter=1", 3, cameras="5"))
    np.testing.assert_array_equal(list(alone.ticks)[7].views[0].detections.bearing, list(worse.ticks)[7].views[1].detections.bearing)


def test_choices_that_cannot_be_are_refused(data: Callable[..., Path], tmp_path: Path) -> None:
    folder, other = data("pets2009", "S2.L1"), data("pets2009", "S2.L1", "mot15", "det.txt")
    with pytest.raises(ValueError, match="no such folder"):
        open_sequence(tmp_path / "nowhere")
    (tmp_path / "detections").mkdir()
    with pytest.raises(ValueError, match="calibration/ in it or beside it"):
        open_sequence(tmp_path)
    with pytest.raises(ValueError, match=r"View_002.txt: no such file; there are View_001, View_003"):
        open_sequence(folder, SourceOptions(("2",)))
    with pytest.raises(ValueError, match="names a camera twice"):
        SourceOptions.parse(cameras="1,1")
    with pytest.raises(ValueError, match="--detections names View_001, --cameras has 5"):
        open_sequence(folder, SourceOptions.parse([f"1={other}"], cameras="5"))
    sequences.write(tmp_path / "s")
    with pytest.raises(ValueError, match="--degrade and --project are for recordings"):
        open_sequence(tmp_path / "s", SourceOptions.parse(degrade="drop=0.5"))


def test_a_folder_of_detections_holds_all_cameras(tmp_path: Path) -> None:
    """With and without files of the folder's own."""
    folder, other = write_pets(tmp_path / "pets"), tmp_path / "found"
    shutil.copytree(folder / "detections", other)
    (folder / "detections" / "View_002.txt").unlink()
    for _ in range(2):
        assert list(open_sequence(folder, SourceOptions.parse([str(other)])).setup.mounts) == ["View_001", "View_002"]
        shutil.rmtree(folder / "detections", ignore_errors=True)


Exported = Callable[[str], Path]


def test_the_terrain_and_the_lens_are_read_back(sequence: Path, exported: Exported) -> None:
    source, again = read_sequence(sequence).setup, open_sequence(exported("pets") / "plaza").setup
    assert list(again.mounts) == ["View_001", "View_002", "View_003"]
    assert again.mounts["View_001"].camera == source.mounts["view_0"].camera
    assert isinstance(again.ground, Grid)
    assert isinstance(source.ground, Grid)
    assert_array_equal(again.ground.heights, source.ground.heights)


def test_annotations_reach_from_feet_to_head(sequence: Path, exported: Exported) -> None:
    name, camera, T = read_camera(exported("pets") / "plaza" / "calibration" / "View_001.xml")
    assert name == "View_001"
    assert isinstance(camera, Tsai)
    source = read_sequence(sequence)
    whole = read_annotations(exported("pets") / "plaza" / "annotations" / "plaza.xml")
    assert list(whole) == list(range(FRAMES))
    for truth in source.truth or ():
        ids, boxes = whole[truth.index]
        assert_array_equal(ids, truth.person_id)
        feet, _ = camera.pixels_from_bearings(T.inverse().apply(truth.feet))
        head, _ = camera.pixels_from_bearings(T.inverse().apply(truth.feet + np.array([0.0, 0.0, 1.72])))
        assert_allclose(boxes[:, 0] + boxes[:, 2] / 2, feet[:, 0], atol=1e-9)
        assert_allclose(boxes[:, 1] + boxes[:, 3], feet[:, 1], atol=1e-9)
        assert_allclose(boxes[:, 1], head[:, 1], atol=4)


def test_names_of_views() -> None:
    assert view_names(["b", "a"]) == {"b": "View_001", "a": "View_002"}
    assert view_names(["View_005", "View_001"]) == {"View_005": "View_005", "View_001": "View_001"}
    assert view_names(["View_005", "View_007"]) == {"View_005": "View_001", "View_007": "View_002"}
    assert view_names(["View_001", "x"]) == {"View_001": "View_001", "x": "View_002"}
