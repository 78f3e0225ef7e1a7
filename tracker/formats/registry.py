"""The table of formats: how a folder of each is recognized, its reader, and its export of a pilsim sequence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tracker.formats import coco, colmap, euroc, kitti, motchallenge, pets2009, recording_export, tum
from tracker.formats.aicity import export as aicity_export
from tracker.formats.aicity.reading import is_aicity, read_aicity
from tracker.formats.jrdb import export as jrdb_export
from tracker.formats.jrdb.reading import is_jrdb, read_jrdb
from tracker.formats.ros import scene
from tracker.formats.source_options import SourceOptions
from tracker.formats.wildtrack import export as wildtrack_export
from tracker.formats.wildtrack.reading import is_wildtrack, read_wildtrack
from tracker.planar_slam.utias_files import is_utias
from tracker.recordings import Recording
from tracker.recordings.folder import is_recording, read_recording

PILSIM, UTIAS = "pilsim", "utias"


@dataclass(frozen=True)
class Export:
    """An export: its name after --format, its title and the description of its files in README.md, and its writer.

    write: takes the folder, an iterable of RecordedSequence and the options by their names, and returns notes for README.md.
    options: names of the fields of ExportOptions that it takes.
    """

    name: str
    title: str
    readme: str
    write: Callable[..., list[str]]
    options: tuple[str, ...] = ()


@dataclass(frozen=True)
class Format:
    """A format.

    name: short, as in --json. title: what it is, and the files that identify it. page: its name in the table of tracker/README.md.
    matches: whether a folder holds it.
    read: the reader of a recording, with `strict` of open_recording; None for a sequence of pilsim, and for UTIAS, which has only robots.
    calibration: the file or folder with the cameras of a recording. export: the export of a sequence of pilsim, or None.
    """

    name: str
    title: str
    page: str
    matches: Callable[[Path], bool]
    read: Callable[[Path, SourceOptions, bool], Recording] | None = None
    calibration: str = ""
    export: Export | None = None


def is_sequence(path: Path) -> bool:
    """Whether a folder is a sequence of pilsim."""
    return (path / "manifest.json").is_file()


SOURCES = (
    Format(PILSIM, "a sequence of pilsim (manifest.json)", "pilsim sequence", is_sequence),
    Format(
        "recording",
        "a recording of one's own (recording.json, detections/)",
        "your own recording",
        is_recording,
        lambda path, _, strict: read_recording(path, strict),
        "recording.json",
        Export("recording", "A recording of one's own", recording_export.README, recording_export.export_recording),
    ),
    Format(UTIAS, "a UTIAS set (Barcodes.dat)", "UTIAS (MRCLAM)", is_utias),
    Format(
        "wildtrack",
        "WILDTRACK or MultiviewX (calibrations/, annotations_positions/)",
        "WILDTRACK, MultiviewX",
        is_wildtrack,
        lambda path, *_: read_wildtrack(path),
        "calibrations",
        Export("wildtrack", "WILDTRACK and MultiviewX", wildtrack_export.README, wildtrack_export.export_wildtrack, ("rectangles",)),
    ),
    Format(
        "jrdb",
        "JRDB (labels_2d_stitched/, labels_3d/)",
        "JRDB",
        is_jrdb,
        lambda path, options, _: read_jrdb(path, options.projected is not None),
        export=Export("jrdb", "JRDB", jrdb_export.README, jrdb_export.export_jrdb),
    ),
    Format(
        "aicity",
        "AI City track 1 (calibration.json, ground_truth.json)",
        "AI City track 1",
        is_aicity,
        lambda path, *_: read_aicity(path),
        "calibration.json",
        Export("aicity", "AI City Challenge, track 1", aicity_export.README, aicity_export.export_aicity),
    ),
    Format(
        "pets2009",
        "PETS 2009 (annotations/ or detections/, calibration/ in it or beside it)",
        "PETS 2009",
        pets2009.is_pets,
        lambda path, options, _: pets2009.read_pets(path, options),
        "calibration",
        Export("pets", "PETS 2009", pets2009.README, pets2009.export_pets),
    ),
)
"""The formats that can be opened, in the order of their tests on a folder."""
WRITTEN = {
    "MOT15, 2-D and 3-D": Export("mot15", "MOTChallenge 2015, 2-D and 3-D", motchallenge.README15, motchallenge.export_mot15),
    "MOT17, MOT20": Export("mot17", "MOTChallenge 2017", motchallenge.README17, motchallenge.export_mot17),
    "COCO": Export("coco", "COCO", coco.README, coco.export_coco),
    "TUM": Export("tum", "TUM trajectories", tum.README, tum.export_tum),
    "EuRoC MAV": Export("euroc", "EuRoC MAV data", euroc.README, euroc.export_euroc, ("epoch", "faces")),
    "KITTI odometry": Export("kitti", "KITTI odometry", kitti.README, kitti.export_kitti),
    "COLMAP": Export("colmap", "COLMAP", colmap.README, colmap.export_colmap),
    "MCAP, ROS 1, ROS 2": Export("mcap", "MCAP with ROS 2 messages", scene.README, scene.export_mcap, ("epoch",)),
}
"""Page → the export of a format that is only written."""
EXPORTS = {export.name: export for export in (*(form.export for form in SOURCES), *WRITTEN.values()) if export is not None}
"""Name after --format → export."""
