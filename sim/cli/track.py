"""The command `pilsim track`: track people and localize robots in a sequence."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.conf import OmitArgPrefixes, Positional, arg

from sim.cli.options import Out, changed_options, unset
from tracker.options import OPTIONS, FilterOptions, HypothesisOptions, ImageOptions, Least, PeopleOptions, parameters_from

if TYPE_CHECKING:
    from tracker.formats.source_options import SourceOptions


@dataclass(frozen=True)
class SourcePart:
    """Cameras and frames of a source, and its detections."""

    cameras: Annotated[str, unset("NAME,...", "all")] = ""
    """Cameras to use, as C1,C3. The number at the end of a name is enough: 1,5 are View_001 and View_005."""
    frames: Annotated[str, unset("A:B", "all")] = ""
    """Frames A to B − 1 to use, counted from 0: 0:100 are the first hundred."""
    detections: tyro.conf.UseAppendAction[
        Annotated[tuple[str, ...], arg(metavar="NAME=FILE", help_behavior_hint="(default: those of the source; repeatable)")]
    ] = ()
    """Other detections (MOT15) for a camera; repeat it for several cameras. A folder with NAME.txt replaces all of them."""


@dataclass(frozen=True)
class SourceChoice(SourcePart):
    """The data of a source that are read."""

    project: Annotated[str | None, unset("misses=P,edges=S", "boxes are read")] = None
    """Boxes of upright bodies (1.75 x 0.5 m) at the true places of all cameras, with this share missing and edges off by this share of the box."""
    degrade: Annotated[str, unset("drop=P,clutter=N,noise=PX", "as they are")] = ""
    """Degradation of the detections: probability of a loss, false boxes per view and frame, noise of the boxes in pixels."""
    offsets: Annotated[str, unset("auto|NAME=S,...", "clocks as they are")] = ""
    """Offsets of the cameras' clocks, s: C2=0.13 for pictures taken later than their stamps say; auto estimates them from people in several views."""
    seed: int = 0
    """Seed of --degrade and --project."""

    def options(self, images: bool, pixels: bool = False) -> SourceOptions:
        """How the source is read. images: whether images are read, too. Raises ValueError as SourceOptions.parse."""
        from tracker.formats.source_options import SourceOptions

        return SourceOptions.parse(self.detections, self.degrade, self.seed, self.cameras, self.frames, images, self.project, pixels, self.offsets)


@dataclass(frozen=True)
class Track:
    """Track people and localize the robots in a sequence.

    The files in SOURCE determine its format:
      - a sequence that pilsim wrote (manifest.json)
      - a recording of your own (recording.json, detections/CAMERA.txt)
      - WILDTRACK or MultiviewX (calibrations/, annotations_positions/)
      - JRDB (labels_2d_stitched/), AI City track 1 (calibration.json)
      - PETS 2009 (annotations/, detections/, and calibration/ in it or beside it)
      - a UTIAS set (MRCLAM), which has robots only

    Examples: pilsim track runs/demo/sequence --out runs/tracks
              pilsim track my-cameras --cameras C1,C3 --frames 0:200 --out runs/mine
              pilsim track PETS2009/S2.L1 --cameras 1,5,7 --out runs/pets
              pilsim track MRCLAM_Dataset1 --map unknown --out runs/utias
    """

    source: Annotated[Positional[Path], arg(metavar="SOURCE")]
    """The folder to track."""
    out: Out
    """Folder of tracks.txt (MOT15, meters) and robots.csv."""
    part: Annotated[OmitArgPrefixes[SourceChoice], arg(name="source")] = SourceChoice()
    """These options choose what of a source is read, and replace or degrade its detections."""
    detector: Literal["given", "simulated", "pixels"] = "given"
    """Boxes of the source, those of a simulated detector, or those found in the images. `simulated` is --project for recordings."""
    model: Annotated[Path | None, unset("FILE.onnx", "the one of the package")] = None
    """The model of --detector pixels, an ONNX file that `train-detector` makes."""
    workers: Annotated[int | None, Least(1), unset("INT", "one a core")] = None
    """Number of threads that find people in images, localize robots and track people. The result does not depend on it."""
    unknown_start: Annotated[str, unset("ROBOT,...", "none")] = ""
    """Robots with an unknown start, as robot_1,robot_2. Each maps alone until its map matches the others' map."""
    map: Literal["known", "unknown"] = "unknown"
    """UTIAS: whether the filter knows the landmarks."""
    people: Annotated[OmitArgPrefixes[PeopleOptions], arg(name="tracking")] = PeopleOptions()
    """These options change the tracker of people; those with a symbol are the paper's."""
    extraction: Annotated[OmitArgPrefixes[ImageOptions], arg(name="image")] = ImageOptions()
    """These options choose what is extracted from images; those with a symbol are the paper's."""
    robots: Annotated[OmitArgPrefixes[FilterOptions], arg(name="expert SLAM")] = FilterOptions()
    """These options choose the filter that estimates the poses of the robots."""
    multiple: Annotated[OmitArgPrefixes[HypothesisOptions], arg(name="expert hypothesis")] = HypothesisOptions()
    """These are the paper's parameters of track trees and of the clique search."""

    def run(self) -> None:
        from sim.parallel.pool import usable_cores
        from tracker.detections.rejections import explain_few_people
        from tracker.formats.opening import format_of, images_checksum, open_sequence
        from tracker.formats.registry import PILSIM, UTIAS
        from tracker.io.resume import INPUTS
        from tracker.person_detector.detected_ticks import detected_in_images
        from tracker.person_detector.network import PersonNetwork
        from tracker.run import check_output, tracked
        from tracker.types import without_starts

        check_output(self.out)
        if format_of(self.source).name == UTIAS:
            self._track_utias()
            return
        if self.map != "unknown":
            raise ValueError(f"{self.source}: --map is for UTIAS sets (Barcodes.dat), and this is none")
        part, pixels = self.part, self.detector == "pixels"
        if self.model and not pixels:
            raise ValueError(f"{self.model}: --model is for --detector pixels")
        threads = usable_cores() if self.workers is None else self.workers
        if self.detector == "simulated" and format_of(self.source).name != PILSIM and part.project is None:
            part = replace(part, project="")
        options = part.options(self.extraction.images, pixels)
        sequence = open_sequence(self.source, options, checked=True)
        if pixels:
            # The network is checked before the long work, and the description of the run names it.
            model = PersonNetwork(self.model).checksum
            sequence = detected_in_images(sequence, self.model, threads)
        first = next((tick for tick in sequence.ticks if tick.views), next(iter(sequence.ticks), None))
        if first is None:
            raise ValueError(f"{self.source}: no frame, since the files of detections hold no box and there is no truth")
        if not first.views:
            raise ValueError(f"{self.source}: no detections of any camera, needs detections/CAMERA.txt (MOT15), --detections or --project")
        unknown = [name.strip() for name in self.unknown_start.split(",") if name.strip()]
        sequence = without_starts(sequence, unknown)
        run = {"source": self.source.name} | options.to_run() | ({"unknown_start": unknown} if unknown else {})
        if pixels:
            run["model"] = model
        if options.images:
            run[INPUTS] = images_checksum(self.source, options)
        parameters = parameters_from(changed_options(self, OPTIONS))
        results = tracked(sequence, self.out, run, parameters, threads)
        people = len({identity for ids, _ in results.tracks.values() for identity in ids.tolist()})
        print(f"{self.out}: {people} people in {results.frames} frames; `pilsim score {self.source} {self.out}` scores it")
        q, places = parameters.targets, sum(len(ids) for ids, _ in results.tracks.values())
        if why := explain_few_people(results.run.get("counters", {}), places, sequence.setup, q.fusion):
            print(why)

    def _track_utias(self) -> None:
        from tracker.planar_slam.event_schedule import PlanarParameters
        from tracker.planar_slam.utias_run import track_utias

        if self.part != SourceChoice():
            raise ValueError(f"{self.source}: --cameras, --frames, --detections and --degrade choose boxes of cameras; a UTIAS set has none")
        if self.unknown_start:
            raise ValueError(f"{self.source}: --unknown-start is for sequences; the robots of a UTIAS set start where their truth begins")
        if self.robots.persistence == "on":
            raise ValueError(f"{self.source}: --persistence is for sequences; biases of a UTIAS set are in the correction factor")
        asked = {"mode": self.robots.slam, "iterations": self.robots.iterations, "correction": self.robots.correction != "off"}
        parameters = PlanarParameters(**{name: value for name, value in asked.items() if value is not None})  # type: ignore[arg-type]
        paths = track_utias(self.source, self.out, self.map == "known", parameters)
        counted = ", ".join(f"{count} {reason}" for reason, count in paths.run["counters"].items() if count) or "no measurements"
        for mended in paths.run["mended"]:
            print(mended)
        print(f"{self.out}: {len(paths.poses)} robots at {len(paths.times)} times ({counted}); `pilsim score {self.source} {self.out}` scores it")
