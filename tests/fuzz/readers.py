"""The table of all readers: a name, a maker of valid files, the file that is damaged, and the reading.

A new format gets a line here; `test_readers.py` then reads damaged files of it, byte order marks, and other line ends.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from sim.datasets.presets import preset_of, read_settings
from sim.policies.training import Curve
from sim.report.findings import headline, moments, summary
from sim.report.page import album_of
from sim.report.plots import overview, plots_of
from sim.report.rows import read_rows
from sim.stress.runner import _read_rows
from sim.studies import STUDIES
from tests.fuzz import samples
from tests.tracker.formats.wildtrack.test_reading import multiviewx
from tracker.clique.dimacs import read_graph
from tracker.datasets.validation import validate
from tracker.formats import pets2009
from tracker.formats.aicity import files as aicity
from tracker.formats.exported_sequence import RecordedSequence
from tracker.formats.jrdb import files as jrdb
from tracker.formats.opening import open_sequence
from tracker.formats.ros.bag_import import BagTopics, read_bag
from tracker.formats.ros.bag_reader import summarize_bag
from tracker.formats.summary import summarize, summary_text
from tracker.formats.wildtrack import files as wildtrack
from tracker.io.csv_tables import read_terrain
from tracker.io.image_files import decode_image
from tracker.io.mot15 import read_detections, read_mot15
from tracker.io.tsai_xml import read_camera
from tracker.planar_slam.trajectories import read_trajectories
from tracker.planar_slam.utias_files import read_utias
from tracker.recordings.images import VideoFile
from tracker.sequence.dataset import read_dataset
from tracker.sequence.manifest import manifest_checksum, read_manifest
from tracker.sequence.reader import read_contents, read_sequence
from tracker.sequence.results import read_results
from tracker.sequence.robot_sensors import SENSOR_TABLES, read_imu, read_sensor_setup, read_stamps, read_wheels
from tracker.sequence.truth_tables import read_joints, read_views


@dataclass(frozen=True)
class Reader:
    """make writes valid files into an empty folder. file: the one that is damaged. read: from the folder.

    form: "lines" where each line is a row, "text" for other text, "binary". sums: whether the manifest has the sum of the file.
    """

    name: str
    make: Callable[[Path], object]
    file: str
    read: Callable[[Path], object]
    form: str = "text"
    sums: bool = False


def _single(name: str, file: str, make: Callable[[Path], object], read: Callable[[Path], object], form: str = "text") -> Reader:
    """A reader of one file that needs no other."""
    return Reader(name, lambda folder: make(folder / file), file, lambda folder: read(folder / file), form)


def _opened(folder: Path) -> object:
    return list(open_sequence(folder).ticks)


def _wildtrack_camera(folder: Path) -> object:
    return wildtrack.read_calibration(folder, "Camera1", (72, 96)).opencv_extrinsics


def _contents(folder: Path) -> object:
    """All of a sequence but its images, without the sums of the manifest."""
    where = folder / "s"
    sequence = read_contents(where, read_manifest(where)["files"])
    odometry = list(sequence.ticks.odometry())
    return odometry, read_views(where), read_joints(where), RecordedSequence(where, sequence).detections, summarize(where)


def _sensors(folder: Path) -> object:
    """The robots' own sensors of a sequence."""
    where = folder / "s"
    return read_imu(where), read_wheels(where), read_stamps(where), read_sensor_setup(where), summary_text(summarize(where))


def _checked(folder: Path) -> object:
    return list(read_sequence(folder / "s").ticks)


def _images(file: str, folder: Path) -> object:
    """The sequence with a manifest that names the damaged image as it is."""
    where = folder / "s"
    manifest, data = json.loads((where / "manifest.json").read_text()), (where / file).read_bytes()
    manifest["files"][file] = {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}
    (where / "manifest.json").write_text(json.dumps(manifest | {"sum": manifest_checksum(manifest)}))
    recorded = RecordedSequence.open(where)
    return list(read_sequence(where).ticks), [recorded.instances(k, "robot_0_camera") for k in range(3)], _validated(folder)


def _validated(folder: Path) -> object:
    return list(validate(folder / "s"))


def _dataset(folder: Path) -> object:
    return read_dataset(folder), list(validate(folder))


def _settings(file: Path) -> object:
    try:
        return preset_of("pilsun", read_settings(file))
    except ValueError as error:
        # The command names the file where a value is out of bounds.
        raise type(error)(f"{file.name}: {error}") if type(error) is ValueError and file.name not in str(error) else error from None


def _report(folder: Path) -> object:
    rows = read_rows(folder)
    album = album_of(folder, moments(rows))
    return headline(rows), summary(rows), overview(rows), [plots_of(sweep, rows.trackers) for sweep in rows.sweeps()], album


def _image(file: Path) -> object:
    try:
        return decode_image(file.read_bytes(), samples.SIZE)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None


def _video(folder: Path) -> object:
    file = folder / "video" / "View_001.mp4"
    return list(VideoFile(file).images(3, (4 * samples.SIZE[0], 4 * samples.SIZE[1])))


def _bag(file: str, folder: Path) -> object:
    """The topics of a bag, and the recording that is made of it."""
    with TemporaryDirectory() as out:
        topics = BagTopics({"/pano/image_raw": "panorama"}, ("/odom",), ("/imu",))
        return summarize_bag(folder / file), read_bag(folder / file, topics, Path(out) / "out")


TABLES = (
    "odometry.csv",
    "detections.csv",
    "companions.csv",
    *(f"truth/{name}.csv" for name in ("robots", "people", "cameras", "boxes", "keypoints", "joints")),
)
FOLDERS = (
    *(Reader(f"sequence {name}", samples.sequence, f"s/{name}", _contents, "lines") for name in TABLES),
    *(Reader(f"sequence {name}", samples.sequence, f"s/{name}", _contents) for name in ("calibration.json", "scenario.json", "manifest.json")),
    Reader("sequence terrain.npz", samples.sequence, "s/terrain.npz", _contents, "binary"),
    Reader("sequence with sums, manifest.json", samples.sequence, "s/manifest.json", _checked),
    Reader("sequence with sums, truth", samples.sequence, "s/truth/people.csv", _checked, "lines", True),
    *(
        Reader(f"sequence {kind}", samples.sequence, f"s/{file}", partial(_images, file), "binary")
        for kind, file in (("images", "images/robot_0_camera/000001.jpg"), ("instances", "instances/robot_0_camera/000001.png"))
    ),
    Reader("validation of calibration.json", samples.sequence, "s/calibration.json", _validated),
    Reader("validation of boxes.csv", samples.sequence, "s/truth/boxes.csv", _validated),
    *(Reader(f"sensors {name}", samples.sensors, f"s/{name}.csv", _sensors, "lines") for name in SENSOR_TABLES),
    Reader("sensors sensors.json", samples.sensors, "s/sensors.json", _sensors),
    Reader("validation of sensors.json", samples.sensors, "s/sensors.json", _validated),
    Reader("validation of imu.csv", samples.sensors, "s/imu.csv", _validated),
    Reader("dataset.json", samples.dataset, "dataset.json", _dataset),
    *(
        Reader(f"results {name}", samples.results, f"r/{name}", lambda folder: read_results(folder / "r"), "text" if name == "run.json" else "lines")
        for name in ("run.json", "tracks.txt", "robots.csv", "map.csv", "sightings.csv")
    ),
    *(
        Reader(
            f"planar results {name}",
            samples.planar,
            f"r/{name}",
            lambda folder: read_trajectories(folder / "r"),
            "text" if name == "run.json" else "lines",
        )
        for name in ("run.json", "robots.csv", "map.csv")
    ),
    *(
        Reader(f"UTIAS {name}", samples.utias, f"u/{name}.dat", lambda folder: read_utias(folder / "u"), "lines")
        for name in ("Barcodes", "Landmark_Groundtruth", "Robot1_Odometry", "Robot1_Measurement", "Robot1_Groundtruth")
    ),
    *(
        Reader(f"PETS 2009 {name}", samples.pets, name, _opened, form)
        for name, form in (
            ("detections/View_001.txt", "lines"),
            ("annotations/PETS-cropped.xml", "text"),
            ("calibration/View_001.xml", "text"),
            ("site.json", "text"),
            ("terrain.npz", "binary"),
        )
    ),
    *(
        Reader(f"recording {name}", samples.recording, name, _opened, form)
        for name, form in (
            ("recording.json", "text"),
            ("detections/C1.txt", "lines"),
            ("truth.txt", "lines"),
            ("robots.json", "text"),
            ("odometry.csv", "lines"),
            ("robot_truth.csv", "lines"),
            ("images/P/000002.png", "binary"),
        )
    ),
    Reader("visible parts", samples.visible_parts, "detections/C1.visible.txt", _opened, "lines"),
    *(Reader(f"AI City {name}", samples.aicity_scene, name, _opened) for name in ("calibration.json", "ground_truth.json", "detections/Camera.txt")),
    *(Reader(f"JRDB folder {kind}", samples.jrdb_folder, f"{kind}/s.json", _opened) for kind in (jrdb.LABELS_2D, jrdb.LABELS_3D, jrdb.DETECTIONS)),
    *(
        Reader(f"MultiviewX {name}", multiviewx, name, _opened)
        for name in ("annotations_positions/00001.json", "calibrations/intrinsic/intr_Camera1.xml", "calibrations/extrinsic/extr_Camera2.xml")
    ),
    Reader("WILDTRACK annotation", samples.wildtrack_folder, "00000.json", lambda folder: wildtrack.read_positions(folder / "00000.json")),
    Reader("WILDTRACK intrinsics", samples.wildtrack_folder, "intrinsic/intr_Camera1.xml", _wildtrack_camera),
    Reader("WILDTRACK extrinsics", samples.wildtrack_folder, "extrinsic/extr_Camera1.xml", _wildtrack_camera),
    Reader("WILDTRACK config.json", samples.wildtrack_folder, "config.json", lambda folder: wildtrack.read_ground_grid(folder / "config.json")),
    Reader("JRDB 2-D", samples.jrdb_files, "2d.json", lambda folder: jrdb.read_labels_2d(folder / "2d.json")),
    Reader("JRDB 3-D", samples.jrdb_files, "3d.json", lambda folder: jrdb.read_labels_3d(folder / "3d.json")),
    Reader("stress report", samples.stress, "results.jsonl", _report),
    Reader("stress picture", samples.stress, "moments/m.png", _report, "binary"),
    Reader("stress resumption", samples.stress, "results.jsonl", _read_rows),
    *(
        Reader(f"bag {form}", partial(samples.bag, form=form), file, partial(_bag, file), "binary")
        for form, file in (("ros1", "walk.bag"), ("sqlite3", "walk/walk.db3"), ("mcap", "walk/walk.mcap"))
    ),
    Reader("video", samples.video, "video/View_001.mp4", _video, "binary"),
)
FILES = (
    _single("CVML", "a.xml", samples.annotations, pets2009.read_annotations),
    _single("Tsai", "View_001.xml", samples.tsai, read_camera),
    _single("pinhole as Tsai", "View_002.xml", samples.plain_camera, read_camera),
    _single("MOT15 truth", "gt.txt", samples.mot15, partial(read_mot15, tracks=True), "lines"),
    _single("MOT15 detections", "det.txt", partial(samples.mot15, detections=True), read_detections, "lines"),
    _single("AI City results", "track1.txt", samples.aicity_results, aicity.read_results, "lines"),
    _single("terrain.npz", "terrain.npz", samples.terrain, read_terrain, "binary"),
    _single("DIMACS", "g.clq", samples.dimacs, read_graph, "lines"),
    _single("settings TOML", "settings.toml", samples.settings_toml, _settings),
    _single("settings JSON", "settings.json", samples.settings_json, _settings),
    _single("JPEG", "a.jpg", samples.image, _image, "binary"),
    _single("PNG", "a.png", samples.image, _image, "binary"),
    _single("PNG of 16 bits", "instances.png", samples.image, _image, "binary"),
    _single("study cells", "cells.csv", samples.cells, STUDIES["fig4"].read, "lines"),
    _single("learning curve", "curve.csv", samples.curve, lambda file: Curve.read(file, 100), "lines"),
)
READERS: dict[str, Reader] = {reader.name: reader for reader in (*FILES, *FOLDERS)}
