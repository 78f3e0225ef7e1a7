"""The cost of writing on top of rendering, and the scaling of generation from one to two workers, with the preset pilsun."""

from __future__ import annotations

import shutil
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from sim.datasets.fixed_cameras import place_cameras
from sim.datasets.generation import Plan, generate
from sim.datasets.presets import PRESETS
from sim.recording.record import SimulatedSequence, rendered_frames, versions
from sim.recording.tracker_setup import make_setup
from sim.simulation.simulation import Simulation
from tests.tracker.sequences import add_images
from tracker.geometry.ground import Grid
from tracker.sequence.writer import ImageForm, SequenceWriter

FRAMES, SCALING = 30, 40


def writing(folder: Path) -> None:
    """Print CPU time and clock time of the same frames, rendered only, and rendered and written."""
    scenario = replace(PRESETS["pilsun"].scenario, frames=FRAMES)
    for form in (ImageForm(), ImageForm(range=True, classes=True), ImageForm(png=True)):
        clock, cpu = {}, {}
        for written in (False, True):
            simulation = Simulation(scenario)
            fixed = place_cameras(simulation.world, 4, 768)
            recording = SimulatedSequence(simulation, fixed, {}, form)
            setup = make_setup(simulation, fixed)
            assert isinstance(setup.occluders, Grid)
            frames = rendered_frames(simulation, setup)
            next(frames)
            begun = time.perf_counter(), time.process_time()
            if written:
                with SequenceWriter(folder / "s", setup, setup.occluders, recording.form) as writer:
                    for m in frames:
                        instances, ranges, classes = (
                            {name: getattr(image, kind) for name, image in m.images.items()} for kind in ("instances", "range", "classes")
                        )
                        add_images(writer, m.tick, instances, ranges, classes)
                        writer.add(m.tick, m.truth, m.views)
                    writer.finish({}, versions())
                shutil.rmtree(folder / "s")
            else:
                for _ in frames:
                    pass
            clock[written], cpu[written] = time.perf_counter() - begun[0], time.process_time() - begun[1]
        drawn, both = (1e3 * cpu[written] / FRAMES for written in (False, True))
        more = [f"{100 * (seconds[True] / seconds[False] - 1):+.0f} %" for seconds in (cpu, clock)]
        print(f"{form}\n  a frame of 8 views: rendered {drawn:.0f} ms of CPU, also written {both:.0f}: {more[0]}, by the clock {more[1]}", flush=True)


def scaling(folder: Path) -> None:
    """Print the time of a dataset with one and with two workers, from the first to the last byte."""
    preset = PRESETS["pilsun"]
    preset = replace(preset, scenario=replace(preset.scenario, frames=SCALING))
    seconds = {}
    for workers in (1, 2):
        begun = time.perf_counter()
        generate(Plan("pilsun", preset, folder / f"of_{workers}", count=4, workers=workers))
        seconds[workers] = time.perf_counter() - begun
        print(f"{workers} workers: 4 sequences of {SCALING} frames in {seconds[workers]:.1f} s", flush=True)
    print(f"two are {seconds[1] / seconds[2]:.2f} x one")


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        writing(Path(name))
        scaling(Path(name))


if __name__ == "__main__":
    main()
