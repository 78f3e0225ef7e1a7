"""The command `pilsim detect`: find people in images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from sim.cli.options import Out, json_text, unset


@dataclass(frozen=True)
class Detect:
    """Find people in the pixels of a video, images or a recording.

    SOURCE is a video, an image, a folder of images or videos, or any source of
    `track` with images. Images of a folder are taken in the order of the numbers in
    their names, upright by their EXIF orientation. Boxes are MOT15, a file a camera.
    The same command continues after an interruption.

    CAMERA.visible.txt has a row for each row of CAMERA.txt, with the box of the
    visible part. Its share of the whole box replaces the probability. Models of
    earlier versions find whole bodies alone.

    Examples: pilsim detect street.mp4 --out runs/boxes --pictures
              pilsim detect PETS2009/S2.L1 --cameras 1 --frames 0:400 --out runs/boxes
    """

    source: Annotated[Positional[Path], arg(metavar="SOURCE")]
    """The images."""
    out: Out
    """Folder of CAMERA.txt: frame from 1, −1, left, top, width, height in pixels, probability."""
    boxes: Literal["whole", "visible"] = "whole"
    """Boxes in CAMERA.txt: of whole bodies, or of their visible parts."""
    cameras: Annotated[str, unset("NAME,...", "all")] = ""
    """Cameras of a recording or sequence to use, as C1,C3."""
    frames: Annotated[str, unset("A:B", "all")] = ""
    """Frames A to B − 1 of a recording or sequence to use, counted from 0."""
    model: Annotated[Path | None, unset("FILE.onnx", "the one of the package")] = None
    """The model, an ONNX file that `train-detector` makes."""
    panorama: bool = False
    """The images are panoramas, whose right edge continues at the left edge. Recordings and sequences store this.

    In images twice as wide as high, people are searched where they can stand, for a
    nearly upright camera 0.8 to 1.8 m high. Sequences and recordings give the height."""
    pictures: bool = False
    """Write the images with the boxes drawn, too."""
    video: bool = False
    """Write a video of each camera with the boxes drawn, too."""
    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from tracker.formats.opening import images_checksum, open_sequence
        from tracker.formats.registry import SOURCES
        from tracker.formats.source_options import SourceOptions
        from tracker.io.picture_folders import READ
        from tracker.io.resume import INPUTS
        from tracker.person_detector.detection_run import DetectionRun, write_detections
        from tracker.person_detector.detector import PersonDetector
        from tracker.person_detector.pictures import (
            frames_of_pictures,
            frames_of_sequence,
            is_pictures,
            number_of_pictures,
            pictures_checksum,
        )
        from tracker.run import check_output

        check_output(self.out)
        how = DetectionRun(PersonDetector(self.model), True if self.panorama else None, self.pictures, self.video, self.boxes == "visible")
        run = {"source": str(self.source.resolve()), "cameras": self.cameras, "frames": self.frames}
        if self.source.exists() and not any(form.matches(self.source) for form in SOURCES) and is_pictures(self.source):
            if self.cameras or self.frames:
                raise ValueError(f"{self.source}: --cameras and --frames are for recordings and sequences")
            run[INPUTS] = pictures_checksum(self.source)
            found = write_detections(frames_of_pictures(self.source), number_of_pictures(self.source), self.out, run, how)
        elif self.source.is_file() and not any(form.matches(self.source) for form in SOURCES):
            raise ValueError(f"{self.source}: is no image or video that is read, needs one of {', '.join(READ)}, or a folder")
        else:
            options = SourceOptions.parse(cameras=self.cameras, frames=self.frames, images=True, pixels=True)
            sequence = open_sequence(self.source, options, calibrated=False)
            run[INPUTS] = images_checksum(self.source, options)
            found = write_detections(frames_of_sequence(sequence), len(sequence.ticks) * len(sequence.setup.mounts), self.out, run, how)
        if self.json:
            print(json_text(found["found"], indent=1))
            return
        for camera, counts in found["found"].items():
            print(f"{self.out / camera}.txt: {counts['boxes']} boxes in {counts['frames']} images")
