"""What each effect of the cameras costs: milliseconds of processor time for a frame of one rover's panorama, beside one without effects.

The scene is pilsun with four people, at 1024 × 512, on one thread. The table shows the median over frames, truth of the view included.
"""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Sequence

from sim.recording.record import open_renderer, run
from sim.recording.tracker_setup import make_setup
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation

EFFECTS = (
    "", "readout=0.01", "readout=0.033", "shutter=0.01", "shutter=0.02,subframes=9", "drops=5", "dust=20", "chromatic=2", "defocus=2", "vignette=1.5",
    "gain=12", "halos=0.5", "jpeg=60", "mount_angle=0.5",
)  # fmt: skip
CAMERAS = ("dual-fisheye:output=stitched", "dual-fisheye", "fisheye", "pinhole", "cylindrical")
FRAMES = 6


def milliseconds(effects: str, camera: str = "", frames: int = FRAMES, width: int = 1024) -> float:
    """Median processor time of a frame, ms; the first frame, which prepares tables, is left out."""
    scenario = Scenario(robots=1, people=4, frames=frames + 1, width=width, effects=effects, camera=camera)
    simulation = Simulation(scenario)
    setup = make_setup(scenario, simulation)
    marks = []
    with open_renderer(scenario, simulation) as renderer:
        for _ in run(scenario, simulation, setup, renderer):
            marks.append(time.process_time())
    return 1000 * statistics.median([b - a for a, b in itertools.pairwise(marks)])


def main(effects: Sequence[str] = EFFECTS, cameras: Sequence[str] = CAMERAS) -> None:
    """Print the table. effects, cameras: texts as of `pilsim generate`; "" is none."""
    plain = milliseconds("")
    print("| camera or effect | frame, ms | more than none, ms |\n|---|---|---|")
    for text, camera in [*((text, "") for text in effects), *(("", camera) for camera in cameras)]:
        cost = milliseconds(text, camera)
        print(f"| {f'`{text or camera}`' if text or camera else 'none'} | {cost:.0f} | {cost - plain:+.0f} |", flush=True)


if __name__ == "__main__":
    main()
