"""The command `pilsim export`: write sequences in formats of other tools."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from sim.cli.options import Out, json_text, unset

Format = Literal["pets", "mot15", "mot17", "wildtrack", "coco", "jrdb", "tum", "aicity", "recording", "euroc", "kitti", "colmap", "mcap"]


@dataclass(frozen=True)
class Export:
    """Write sequences in a format that other tools read.

    README.md in the result explains every column. The formats are:
      - pets       PETS 2009: CVML truth, Tsai cameras (fixed pinhole cameras only)
      - mot15      MOTChallenge 2015, one sequence a view
      - mot17      MOTChallenge 2017, one sequence a view
      - wildtrack  WILDTRACK and MultiviewX (fixed pinhole cameras only)
      - coco       COCO with masks, key points and tracks
      - jrdb       JRDB: panoramas
      - tum        TUM: trajectories of robots
      - euroc      EuRoC MAV data for SLAM: a folder a robot, true states
      - kitti      KITTI odometry: a sequence a robot, true poses
      - colmap     COLMAP: images with exact poses, panoramas as six pinholes
      - mcap       a bag of ROS 2 (MCAP), for Foxglove and `ros2 bag play`:
                   images, calibration, boxes, odometry, TF, people, terrain
                   (needs pip install 'pilsim[ros]')
      - aicity     AI City Challenge, track 1 (fixed pinhole cameras only); of the
                   results of `track`: the one text file of a submission
      - recording  pilsim's open format (recording.json), of any source:
                   PETS 2009, WILDTRACK, JRDB and AI City, too

    Examples: pilsim export runs/pilsun --format mot17 --out runs/mot17
              pilsim export runs/pilsun/pilsun-00000 --format coco --out runs/coco
              pilsim export runs/pilsun --format euroc --faces --out runs/euroc
    """

    source: Annotated[Positional[Path], arg(metavar="DIR")]
    """A sequence, a folder of sequences, or any source of `pilsim track` for --format recording."""
    format: Format
    """The format to write."""
    out: Out
    """Folder of the result; it must not exist yet."""
    rectangles: bool = False
    """wildtrack: write rectangles.pom too, a line for every camera and cell (millions of lines)."""
    faces: bool = False
    """euroc: give a panorama as six pinhole images of 90°, in place of one that pinhole programs cannot read."""
    epoch: Annotated[int, arg(metavar="SECONDS")] = 0
    """euroc, mcap: the time of the first frame in whole seconds, for instance a Unix time."""
    scene: Annotated[int | None, unset("INT", "the number in the name of what was tracked")] = None
    """aicity, of results: scene_id of the file."""
    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from tracker.formats.aicity.export import export_results, is_results
        from tracker.formats.exporting import ExportOptions, export, export_source
        from tracker.formats.opening import is_pilsim
        from tracker.formats.registry import SOURCES
        from tracker.io.progress import progress_bar

        def progress(frames: Iterable[int], name: str) -> Iterable[int]:
            return progress_bar(frames, desc=name, unit="frame", disable=self.json)

        results = self.format == "aicity" and is_results(self.source)
        if self.scene is not None and not results:
            raise ValueError("--scene is for the results of `track` with --format aicity")
        done: dict[str, Any] = {"out": str(self.out), "format": self.format}
        if results:
            done["scene"] = export_results(self.source, self.out, self.scene)
            said = f"track1.txt of scene {done['scene']}"
        elif self.format == "recording" and self.source.is_dir() and not is_pilsim(self.source):
            export_source(self.source, self.out)
            said = f"a recording; `pilsim track {self.out}` reads it"
        else:
            other = next((form for form in SOURCES if form.matches(self.source)), None)
            if other is not None and not is_pilsim(self.source):
                raise ValueError(f"{self.source}: is {other.title}, which --format recording writes; {self.format} needs a sequence of pilsim")
            found = export(self.source, self.format, self.out, progress, ExportOptions(self.rectangles, self.epoch, self.faces))
            done["sequences"] = [str(path) for path in found]
            said = f"{len(found)} sequence{'s' * (len(found) != 1)} as {self.format}; README.md in it explains every column"
        print(json_text(done) if self.json else f"{self.out}: {said}")
