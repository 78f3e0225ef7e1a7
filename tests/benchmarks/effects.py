"""What each effect of the cameras costs: milliseconds of processor time for a frame of one rover's panorama, beside one without effects.

The scene is pilsun with four people, at 1024 × 512, on one thread. The table shows the median over frames, truth of the view included.
With the name of a file, the command draws a picture of each effect on the quarry instead, beside one without effects.
"""

from __future__ import annotations

import itertools
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from sim.recording.frames import Frame
from sim.recording.record import rendered_frames
from sim.recording.tracker_setup import make_setup
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tracker.geometry import Image

EFFECTS = (
    "", "readout=0.01", "readout=0.033", "shutter=0.01", "shutter=0.02,subframes=9", "drops=5", "dust=20", "chromatic=2", "defocus=2", "vignette=1.5",
    "gain=12", "halos=0.5", "jpeg=60", "mount_angle=0.5",
)  # fmt: skip
CAMERAS = ("dual-fisheye:output=stitched", "dual-fisheye", "fisheye", "pinhole", "cylindrical")
FRAMES = 6
SHOWN = (
    "", "readout=0.1", "shutter=0.06,subframes=9", "seam=1", "vignette=3", "defocus=4", "chromatic=5", "halos=2", "gain=36", "jpeg=5", "dust=25",
    "drops=16",
)  # fmt: skip
"""Effects of the picture, stronger than those of real cameras, so that they are seen."""
STITCHED = "dual-fisheye:output=stitched"
"""The camera of `seam`, which needs two lenses."""


def simulated(scenario: Scenario) -> Iterator[Frame]:
    """The frames of the scenario, rendered with its cameras and effects."""
    simulation = Simulation(scenario)
    yield from rendered_frames(simulation, make_setup(simulation))


def milliseconds(effects: str, camera: str = "", frames: int = FRAMES, width: int = 1024) -> float:
    """Median processor time of a frame, ms; the first frame, which prepares tables, is left out."""
    scenario = Scenario(robots=1, people=4, frames=frames + 1, width=width, effects=effects, camera=camera)
    marks = [time.process_time() for _ in simulated(scenario)]
    return 1000 * statistics.median([b - a for a, b in itertools.pairwise(marks)])


def image_with(effects: str, frames: int = 8, width: int = 1024) -> Image:
    """The last of `frames` panoramas (width / 2, width, 3) of a fast rover in the quarry."""
    camera = STITCHED if "seam" in effects else ""
    scenario = Scenario(
        world="quarry", seed=3, robots=1, people=8, frames=frames, width=width, speed=1.2, effects=effects, camera=camera, image_noise=0.0
    )
    *_, last = simulated(scenario)
    image = last.tick.views[0].image
    assert image is not None
    return image


def picture(path: Path, effects: Sequence[str] = SHOWN) -> None:
    """Write a sheet with two columns: the middle of a panorama with each of the effects, under its name."""
    panels = []
    for text in effects:
        image = image_with(text)
        height, width = image.shape[:2]
        panel = np.ascontiguousarray(image[height // 4 : 3 * height // 4, width // 8 : 7 * width // 8])
        panels.append(cv2.putText(panel, text or "none", (12, 30), cv2.FONT_HERSHEY_DUPLEX, 0.8, (255, 255, 255), 1, cv2.LINE_AA))
    rows = [np.hstack(panels[k : k + 2]) for k in range(0, len(panels), 2)]
    cv2.imwrite(str(path), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])


def main(effects: Sequence[str] = EFFECTS, cameras: Sequence[str] = CAMERAS) -> None:
    """Print the table. effects, cameras: texts as of `pilsim generate`; "" is none."""
    plain = milliseconds("")
    print("| camera or effect | frame, ms | more than none, ms |\n|---|---|---|")
    for text, camera in [*((text, "") for text in effects), *(("", camera) for camera in cameras)]:
        cost = milliseconds(text, camera)
        print(f"| {f'`{text or camera}`' if text or camera else 'none'} | {cost:.0f} | {cost - plain:+.0f} |", flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        picture(Path(sys.argv[1]))
    else:
        main()
