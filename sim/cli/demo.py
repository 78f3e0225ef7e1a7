"""The command `pilsim demo`: simulate a sequence, track it, score it, and draw the result."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import OmitArgPrefixes, arg

from sim.cli.options import USUAL, BoxOptions, CameraSettings, Out, SceneOptions, camera_given, given, json_text, print_place

if TYPE_CHECKING:
    from sim.scenario import Scenario
    from tracker.sequence.results import Results
    from tracker.types import Sequence

STATEMENT = "sequence/scenario.json"
PICTURES = ("contact_sheet.png", "plan.png", "video.mp4")


@dataclass(frozen=True)
class Demo:
    """Simulate people and robots, track them, score and draw the result.

    The command runs the whole pipeline once, at 6 frames a second.

    With --detector pixels, boxes of people come from the panoramas, as landmarks do,
    and not from the truth.

    Examples: pilsim demo
              pilsim demo --detector pixels --out runs/pixels
              pilsim demo --frames 333 --seed 7 --out runs/seven
    """

    frames: int = 60
    """Number of frames, at 6 a second; the paper's set has 333."""
    seed: int = 0
    """Seed of all random numbers; the same seed gives the same bytes."""
    width: int = 1024
    """Width of a panorama, pixels; it is half as high."""
    out: Out = Path("runs/demo")
    """Folder of all results. A run of the same scenario reuses them."""
    scene: Annotated[OmitArgPrefixes[SceneOptions], arg(name="scene")] = USUAL
    """These options set the world, its people and its robots."""
    boxes: Annotated[OmitArgPrefixes[BoxOptions], arg(name="detector")] = BoxOptions()
    """These options choose where the boxes of people come from."""
    cameras: Annotated[OmitArgPrefixes[CameraSettings], arg(name="cameras")] = CameraSettings()
    """These options change the cameras."""

    def run(self) -> None:
        from sim.scenario import Scenario
        from tracker.detector_models.model import chosen_model

        chosen = given(self.scene) | camera_given(self.cameras) | {"detector_model": chosen_model(self.boxes.detector_model)}
        scenario = Scenario(seed=self.seed, frames=self.frames, width=self.width, **chosen)
        from tracker.io.file_lock import folder_lock

        pixels = self.boxes.pixels
        scenario.check_any_camera(fixed=0)
        check_folder(scenario, self.out)
        # The lock is taken before the imports of the renderer and the tracker, which take seconds.
        with folder_lock(self.out):
            run_demo(scenario, self.out, pixels, self.boxes.model)


def run_demo(scenario: Scenario, out: Path, pixels: bool = False, model: Path | None = None) -> dict[str, Any]:
    """Run the whole pipeline into a folder, and return the scores. Parts of the same scenario in the folder are reused.

    pixels: whether boxes are found in the panoramas, by `model` or the model of the package; otherwise they are simulated.
    The caller holds the lock of the folder. Raises ValueError where it holds another run, and for a model that cannot be used.
    """
    from sim.parallel.pool import usable_cores
    from sim.recording.record import record
    from tracker.geometry.compile_ahead import compiling
    from tracker.io.atomic import is_free, write_text
    from tracker.io.progress import progress_bar
    from tracker.io.resume import json_value
    from tracker.metrics.evaluation import evaluate, table
    from tracker.person_detector.detected_ticks import detected_in_images
    from tracker.person_detector.network import PersonNetwork
    from tracker.pipeline import Parameters
    from tracker.run import tracked
    from tracker.sequence.reader import read_sequence
    from tracker.sequence.results import read_results

    check_folder(scenario, out)
    # The model is checked before the long work, and the description of the run names it.
    run: dict[str, Any] = {"source": "sequence", "views": []} | ({"model": PersonNetwork(model).checksum} if pixels else {})
    folder = out / "sequence"
    # On the first run, the tracker's kernels are compiled while the sequence is made.
    with compiling(2 if usable_cores() > 1 else 0) as processes:
        if not folder.exists():
            record(scenario, folder, partial(progress_bar, desc="panoramas", unit="frame"), usable_cores())
        for process in processes:
            process.wait()
    sequence = read_sequence(folder)
    if not is_free(out / "track"):
        there = read_results(out / "track").run
        if there.get("parameters") != json_value(Parameters()) or there.get("model") != run.get("model"):
            print(f"{out / 'track'}: made with other parameters of the tracker or other boxes; tracking anew")
            for name in PICTURES:
                (out / name).unlink(missing_ok=True)
            shutil.rmtree(out / "track")
    cores = usable_cores()
    results = tracked(detected_in_images(sequence, model, cores) if pixels else sequence, out / "track", run, threads=cores)
    scores = evaluate(sequence, results)
    write_text(out / "scores.json", json_text(scores, indent=1) + "\n")
    draw(sequence, results, scores, out)
    print(table(scores))
    print_place(folder)
    _print_files(out)
    return scores


def check_folder(scenario: Scenario, out: Path) -> None:
    """Raises ValueError where a folder holds anything but a run of this scenario."""
    from tracker.io.atomic import partial_path
    from tracker.io.json_files import read_json
    from tracker.io.resume import check_same, holds_run

    if holds_run(out, STATEMENT, (partial_path(out / "sequence").name,)):
        stored = read_json(out / STATEMENT)
        if not isinstance(stored, dict):
            raise ValueError(f"{out / STATEMENT}: no scenario")
        check_same(out, stored, json.loads(scenario.to_json()))


def draw(sequence: Sequence, results: Results, scores: dict[str, Any], out: Path) -> None:
    """Draw contact sheet, plan and video, where they are missing. The plan is drawn in a thread, beside the video."""
    from concurrent.futures import ThreadPoolExecutor

    from sim.visualization.overlays import annotated, contact_sheet, save_png
    from sim.visualization.plan_and_video import plan, video_frames, write_video
    from tracker.io.progress import progress_bar

    people, robots = scores["targets"], scores["robots"]
    title = f"MOTA {people['mota'] or 0:.3f}, IDF1 {people['idf1'] or 0:.3f}; ATE {robots['ate_m']:.3f} m"
    title += f" (dead reckoning {scores['dead_reckoning']['ate_m']:.3f} m)"
    if not (out / "contact_sheet.png").exists():
        chosen = 2 * len(sequence.ticks) // 3
        tick = next(islice(iter(sequence.ticks), chosen, None))
        save_png(out / "contact_sheet.png", contact_sheet(annotated(sequence, results, tick), f"frame {tick.index}: estimated boxes and ids"))
    with ThreadPoolExecutor(1) as beside:
        planned = None if (out / "plan.png").exists() else beside.submit(plan, sequence, results, title, out / "plan.png")
        if not (out / "video.mp4").exists():
            ticks = progress_bar(sequence.ticks, total=len(sequence.ticks), desc="video", unit="frame")
            write_video(out / "video.mp4", video_frames(sequence, results, ticks), 1 / sequence.setup.period)
        if planned is not None:
            planned.result()


def _print_files(out: Path) -> None:
    """Print the files of the folder and their content."""
    for name, meaning in (
        ("scores.json", "all scores"),
        ("contact_sheet.png", "panoramas with estimated boxes"),
        ("plan.png", "true and estimated paths"),
        ("video.mp4", "both as a video"),
        ("sequence/", "panoramas, instances, truth, odometry, calibration (README.md in it)"),
        ("track/", "estimated tracks and poses"),
    ):
        print(f"{out / name}: {meaning}")
