"""Opening of sources: every format is told apart, options choose parts of each, and what is wrong is said in one line with file and field."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest

from sim.cli.export import Format
from tests.tracker.formats.small_sources import FRAMES, RECORDINGS, SOURCES
from tracker.formats.opening import format_of, open_recording, open_sequence
from tracker.formats.registry import EXPORTS, WRITTEN
from tracker.formats.registry import SOURCES as FORMATS
from tracker.formats.source_options import SourceOptions
from tracker.formats.summary import summarize
from tracker.metrics.evaluation import evaluate
from tracker.run import tracked
from tracker.sequence.schema import ODOMETRY

Change = Callable[[Path], object]
SECOND = {"jrdb": "panorama", "pets": "View_002"}
"""The name of a camera of each kind; C2 of the others."""


@pytest.mark.parametrize("kind", SOURCES)
def test_each_format_is_told_by_one_reader(tmp_path: Path, kind: str) -> None:
    name, write = SOURCES[kind]
    folder = write(tmp_path / kind)
    assert [form.name for form in FORMATS if form.matches(folder)] == [name]
    assert format_of(folder).name == name


def test_all_formats_have_a_small_folder() -> None:
    assert {form.name for form in FORMATS} == {name for name, _ in SOURCES.values()}


def test_a_folder_of_no_format_lists_all(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds nothing that pilsim opens") as error:
        format_of(tmp_path)
    assert all(form.title in str(error.value) for form in FORMATS)
    (tmp_path / "recording.txt").touch()
    with pytest.raises(ValueError, match=r"recording.txt: is a file, needs the folder of one of: a sequence of pilsim \(manifest.json\); "):
        format_of(tmp_path / "recording.txt")


def test_a_dataset_names_its_sequences(tmp_path: Path) -> None:
    (tmp_path / "dataset.json").write_text("{}")
    for k in range(2):
        SOURCES["pilsim"][1](tmp_path / f"pilsun-{k:05d}")
    with pytest.raises(ValueError, match=r"is a dataset, needs one of its sequences: pilsun-00000, pilsun-00001$"):
        format_of(tmp_path)


PARTS: tuple[dict[str, Any], ...] = (
    {"frames": "2:10", "degrade": "drop=0.2,noise=1", "seed": 3},
    {"project": "misses=0.1,edges=0.02", "frames": ":7"},
    {"detections": True, "cameras": True, "frames": "1:"},
)


@pytest.mark.parametrize(("kind", "options"), [(kind, PARTS[k % len(PARTS)]) for k, kind in enumerate(RECORDINGS)])
def test_scores_read_the_part_that_was_tracked(tmp_path: Path, kind: str, options: dict[str, Any]) -> None:
    """run.json opens the same part; the same command reads the results back; another one is refused."""
    folder, camera, given = SOURCES[kind][1](tmp_path / kind), SECOND.get(kind, "C2"), dict(options)
    if given.pop("detections", False):
        (tmp_path / f"{camera}.txt").write_text("5,-1,600,200,50,150,0.9,-1,-1,-1\n")
        given |= {"detections": [str(tmp_path)], "cameras": camera}
    chosen = SourceOptions.parse(**given)
    sequence = open_sequence(folder, chosen)
    first, end = chosen.frames or (0, None)
    assert len(sequence.ticks) == min(end or FRAMES, FRAMES) - first
    results = tracked(sequence, tmp_path / "out", chosen.to_run())
    again = open_sequence(folder, SourceOptions.of_run(json.loads((tmp_path / "out" / "run.json").read_text())))
    assert again.provenance == sequence.provenance
    assert evaluate(again, results)["targets"]["truths"] > 0
    boxes = [[view.detections.bearing.tolist() for tick in s.ticks for view in tick.views] for s in (sequence, again)]
    assert boxes[0] == boxes[1]
    both = results, tracked(again, tmp_path / "out", chosen.to_run())
    seen = [{k: sorted(ids.tolist()) for k, (ids, _) in r.tracks.items() if len(ids)} for r in both]
    assert seen[0] == seen[1]
    other = SourceOptions.parse(frames="3:8")
    with pytest.raises(ValueError, match="holds another run") as error:
        tracked(open_sequence(folder, other), tmp_path / "out", other.to_run())
    assert "\n" not in str(error.value)


def test_results_open_the_source_with_the_offsets_of_their_run(tmp_path: Path) -> None:
    folder = SOURCES["own"][1](tmp_path / "own")
    chosen = SourceOptions.parse(offsets="C2=0.5")
    assert SourceOptions.of_run(chosen.to_run()).offsets == "C2=0.5"
    assert len(open_sequence(folder, SourceOptions.of_run(chosen.to_run())).ticks) == len(open_sequence(folder, chosen).ticks) > FRAMES


def test_one_robot_of_a_team(tmp_path: Path) -> None:
    """The camera of a robot sees the other robot, which the part does not have."""
    folder = SOURCES["pilsim"][1](tmp_path / "s")
    sequence = open_sequence(folder, SourceOptions.parse(cameras="robot_0_camera"))
    assert list(sequence.setup.starts) == ["robot_0"]
    assert [view.robot_detections.robot for tick in sequence.ticks for view in tick.views if view.robot_detections is not None] == [()] * 3
    tracked(sequence, tmp_path / "out", {})


@pytest.mark.parametrize("kind", [*RECORDINGS, "pilsim"])
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frames": "300:400"}, r"--frames (is 300:400|begins at 300), needs a first frame below \d+, all that .* has"),
        ({"cameras": "C9"}, "camera is 'C9', needs one of "),
    ],
)
def test_parts_that_are_not_there(tmp_path: Path, kind: str, options: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        open_sequence(SOURCES[kind][1](tmp_path / kind), SourceOptions.parse(**options))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cameras": ","}, "--cameras is ',', needs names"),
        ({"detections": ["nonsense"]}, "--detections is 'nonsense', needs CAMERA=FILE"),
        ({"detections": ["C1=/nowhere.txt"]}, "/nowhere.txt: no such file"),
        ({"degrade": "drop=nan"}, "drop is nan, needs 0 to 1"),
        ({"degrade": "clutter=1.5"}, "--degrade has 'clutter=1.5', needs a whole number"),
        ({"project": "misses=x"}, "--project has 'misses=x', needs a number"),
        ({"seed": -1}, "--seed is -1, needs 0 or more"),
    ],
)
def test_options_without_meaning(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SourceOptions.parse(**options)


def edited(pattern: str, change: Callable[[Any], object]) -> Change:
    """A change of the JSON content of the first file of this pattern."""

    def edit(folder: Path) -> None:
        file = min(folder.glob(pattern))
        content = json.loads(file.read_text())
        change(content)
        file.write_text(json.dumps(content))

    return edit


def written(name: str, text: str) -> Change:
    def write(folder: Path) -> None:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)

    return write


def file_in_place_of(name: str) -> Change:
    def put(folder: Path) -> None:
        shutil.rmtree(folder / name)
        (folder / name).write_text("")

    return put


def folder_in_place_of(name: str) -> Change:
    def put(folder: Path) -> None:
        (folder / name).unlink()
        (folder / name).mkdir()

    return put


def robot(entry: object) -> Change:
    """A camera on a robot with this entry in robots.json."""

    def write(folder: Path) -> None:
        edited("recording.json", lambda c: c["cameras"]["C1"].update(robot="r0"))(folder)
        (folder / "robots.json").write_text(json.dumps({"r0": entry}))
        (folder / "odometry.csv").write_text("")

    return write


BOX = "1,-1,1,1,9,9,1,-1,-1,-1\n"
RECORDING, SENSORS = "recording.json", "calibration.json"
NAN = float("nan")
FAULTS: dict[str, tuple[str, Change, str]] = {
    "area of text": ("own", edited(RECORDING, lambda c: c.update(area="big")), r"recording.json: area is 'big', needs two corners x, y in metres"),
    "one height": ("own", edited(RECORDING, lambda c: c.update(height=1.7)), r"recording.json: height is 1.7, needs 2 numbers"),
    "frames that are no number": ("own", edited(RECORDING, lambda c: c.update(frames=True)), r"recording.json: frames is True, needs a whole number"),
    "NaN": ("own", edited(RECORDING, lambda c: c["cameras"]["C1"].update(t=[NAN, 0, 0])), r"recording.json: holds NaN, needs finite numbers"),
    "a folding fisheye": (
        "own",
        edited(RECORDING, lambda c: c["cameras"]["C1"].update(model="fisheye", distortion=[-1.5, 0, 0, 0])),
        r"recording.json: cameras.C1: distortion .* folds within the image: \d+ px from",
    ),
    "detections of another ending": ("own", written("detections/C1.csv", BOX), r"detections/C1.csv: is of camera 'C1', needs the name C1.txt"),
    "a file for detections": ("own", file_in_place_of("detections"), r"detections: is a file, needs to be a folder with CAMERA.txt"),
    "a folder for truth": ("own", folder_in_place_of("truth.txt"), r"Is a directory: .*truth.txt"),
    "a robot in a list": ("own", robot([1]), r"robots.json: r0: a JSON list, needs an object"),
    "a place of two numbers": ("own", robot({"start": {"position": [1, 2]}}), r"robots.json: r0: start: position is \[1, 2\], needs "),
    "no known start": ("own", robot({"start": None}), r"robots.json: start is null of each robot, needs one with a start"),
    "a camera of AI City below the ground": (
        "aicity",
        edited(SENSORS, lambda c: c["sensors"][0].update(extrinsicMatrix=[[1, 0, 0, 0], [0, 0, -1, -5], [0, 1, 0, 0]])),
        r"calibration.json: cameras.C1.t puts the camera at \(0.00, 0.00, -5.00\) m, 5.00 m below the ground",
    ),
    "frames of images, not of labels": (
        "jrdb",
        written("detections/scene.txt", BOX.replace("1", "61", 1)),
        r"detections/scene.txt: frame is 61, needs at most 12, the number of labelled frames",
    ),
    "a view without calibration": ("pets", written("detections/View_009.txt", BOX), r"No such file or directory: .*calibration/View_009.xml"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_bad_content_is_named_in_one_line(tmp_path: Path, fault: str) -> None:
    kind, change, message = FAULTS[fault]
    folder = SOURCES[kind][1](tmp_path / kind)
    change(folder)
    with pytest.raises((ValueError, OSError), match=message) as error:
        open_recording(folder)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", RECORDINGS)
def test_images_that_are_not_there(tmp_path: Path, kind: str) -> None:
    with pytest.raises(ValueError, match=r"no images, neither video/CAMERA.mp4 nor images/CAMERA/000001.jpg, of "):
        open_sequence(SOURCES[kind][1](tmp_path / kind), SourceOptions(images=True))


def test_images_of_another_size_and_short_videos(tmp_path: Path) -> None:
    folder = SOURCES["own"][1](tmp_path / "own")
    (folder / "images" / "C1").mkdir(parents=True)
    cv2.imwrite(str(folder / "images" / "C1" / "000001.png"), np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(ValueError, match=r"images/C1/000001.png: is 64 x 48 px, its camera 1280 x 720 px"):
        list(open_sequence(folder, SourceOptions(images=True)).ticks)
    (folder / "video").mkdir()
    film = cv2.VideoWriter(str(folder / "video" / "C1.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 4.0, (1280, 720))
    for _ in range(3):
        film.write(np.zeros((720, 1280, 3), np.uint8))
    film.release()
    with pytest.raises(ValueError, match=r"video/C1.mp4: has 3 frames, the recording has "):
        list(open_sequence(folder, SourceOptions(images=True)).ticks)


@pytest.mark.parametrize(
    ("kind", "name"), [("own", "truth.txt"), ("pets", "annotations"), ("jrdb", "labels/labels_3d"), ("aicity", "ground_truth.json")]
)
def test_scores_need_truth(tmp_path: Path, kind: str, name: str) -> None:
    folder = SOURCES[kind][1](tmp_path / kind)
    file = folder / name
    if file.is_dir():
        shutil.rmtree(file)
    else:
        file.unlink()
    sequence = open_sequence(folder)
    with pytest.raises(ValueError, match=r"this source has no truth to score against, needs truth.txt \(PETS 2009: annotations/"):
        evaluate(sequence, tracked(sequence, tmp_path / "out", {}))


def test_boxes_of_robots_need_their_true_poses(tmp_path: Path) -> None:
    folder = SOURCES["own"][1](tmp_path / "own")
    robot({"start": {"position": [0, 0, 0], "quaternion": [1, 0, 0, 0]}})(folder)
    (folder / "odometry.csv").write_text(",".join(ODOMETRY) + "\n")
    with pytest.raises(ValueError, match=r"camera C1 is on robot r0, which has no true poses \(robot_truth.csv\)"):
        open_recording(folder, SourceOptions.parse(project=""))


def test_a_summary_names_the_models_of_cameras(tmp_path: Path) -> None:
    found = {kind: list(summarize(SOURCES[kind][1](tmp_path / kind))["cameras"].values()) for kind in ("own", "jrdb", "pets")}
    assert found == {"own": ["pinhole 1280 x 720"] * 2, "jrdb": ["cylindrical 3760 x 480"], "pets": ["tsai 1280 x 720"] * 2}


def test_readme_has_a_row_for_each_format() -> None:
    """The table of tracker/README.md says of each format what the table in the code does."""
    text = (Path(__file__).parents[3] / "tracker" / "README.md").read_text(encoding="utf-8")
    rows = {cells[0]: cells for line in text.splitlines() if len(cells := [cell.strip() for cell in line.strip("|").split("|")]) == 7}
    opened = [(form.page, True, form.export) for form in FORMATS]
    for page, is_opened, export in (*opened, *((page, False, export) for page, export in WRITTEN.items())):
        _, _, read, _, _, written, _ = rows[page]
        assert (read == "yes") == is_opened, page
        assert (export is not None) == ("`export --format" in written), page
        assert export is None or f"`export --format {export.name}`" in written, page
    assert set(get_args(Format)) == set(EXPORTS)
