"""The task of generating one sequence of a dataset. The same task gives the same bytes in any process."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from sim.datasets.fixed_cameras import corner_cameras, place_cameras
from sim.datasets.presets import Preset, confine, provenance
from sim.datasets.raycast_recording import write_raycast_recording
from sim.parallel.pool import drawing_alone
from sim.recording.drawing_workers import DrawingWorkers, drawing_workers
from sim.recording.frame_journal import NAME as JOURNAL
from sim.recording.record import SimulatedSequence, write_sequence
from sim.recording.tracker_setup import cameras_of
from sim.simulation.simulation import Simulation, furnished
from tracker.io.atomic import partial_path
from tracker.io.file_lock import Locked, file_lock
from tracker.sequence.dataset import MANIFEST
from tracker.sequence.writer import ImageForm
from worlds import catalogue


@dataclass(frozen=True)
class SequenceTask:
    """A sequence to generate: its folder, the name and value of its preset, and the form of its images.

    workers: number of processes that draw. cluster: as of SimulatedSequence.
    """

    folder: Path
    name: str
    preset: Preset
    form: ImageForm
    workers: int = 1
    cluster: str | None = None

    def cast(self) -> None:
        """Write a recording by ray casting in place of the sequence. Raises ValueError as `run`."""
        write_raycast_recording(self.simulated(), self.folder)

    @property
    def complete(self) -> bool:
        """Whether the sequence is on disk."""
        return (self.folder / MANIFEST).is_file()

    @property
    def partial(self) -> Path:
        """The temporary folder of the unfinished sequence."""
        return partial_path(self.folder)

    @property
    def frames(self) -> int:
        """The number of frames on disk, of a complete or an unfinished sequence."""
        if self.complete:
            return self.preset.scenario.frames
        try:
            images = self.partial / "images"
            return len(os.listdir(images / sorted(os.listdir(images))[0]))
        except (OSError, IndexError):
            return 0

    def remove_leftovers(self, resumable: bool = False) -> None:
        """Remove the files of a killed run. A sequence that another process writes stays. resumable: whether to keep what can be resumed."""
        if resumable and (self.partial / JOURNAL).exists():
            return
        if self.partial.exists() or self._lock.exists():
            with suppress(Locked), file_lock(self._lock):
                shutil.rmtree(self.partial, ignore_errors=True)

    @property
    def _lock(self) -> Path:
        return self.folder.with_name(f".{self.folder.name}.lock")

    def run(self) -> None:
        """Wait for other writers, and write the sequence unless it is complete then.

        Raises ValueError for a scenario that does not fit into its world, and where the linear algebra of this process has several threads.
        """
        with drawing_alone(), file_lock(self._lock, wait=True):
            if not self.complete:
                count = min(self.workers, self.preset.scenario.frames) if self.cluster is None else 1
                with drawing_workers(count) as drawing:
                    write_sequence(self.simulated(drawing), self.folder)

    def simulated(self, drawing: DrawingWorkers | None = None) -> SimulatedSequence:
        """The simulation of the preset at its first frame, with its fixed cameras. Raises ValueError as `run`."""
        scenario = self.preset.scenario
        world = catalogue.build(scenario.world, scenario.stream("world"), scenario.difficulty)
        world = confine(world, self.preset.ground, scenario.stream("world/confined"))
        world = furnished(world, scenario)
        place = corner_cameras if self.preset.corners else place_cameras
        fixed = cameras_of(world, scenario.view_width) or place(world, self.preset.views, scenario.view_width)
        simulation, made_by = Simulation(scenario, world=world), provenance(self.name, self.preset)
        return SimulatedSequence(simulation, fixed, made_by, self.form, drawing, self.cluster)
