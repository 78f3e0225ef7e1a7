"""One sequence of a dataset, made by whatever process is told to: the same order gives the same bytes anywhere."""

from __future__ import annotations

import os
import shutil
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from sim.datasets.fixed_cameras import place_cameras
from sim.datasets.presets import Preset, confined, provenance
from sim.parallel.file_lock import Locked, file_lock
from sim.recording.record import Recording, write_recording
from sim.simulation.simulation import Simulation
from tracker.io.atomic import partial_path
from tracker.sequence.dataset import MANIFEST
from tracker.sequence.writer import ImageForm
from worlds import catalogue

WATCH = 0.3
"""s between looks at whether the master is alive."""
_one_at_a_time = threading.Lock()
_followed: set[int] = set()


@dataclass(frozen=True)
class SequenceTask:
    """A sequence to be made: where, of which preset under which name, in what form. master: the process without which it is not wanted, or None."""

    folder: Path
    name: str
    preset: Preset
    form: ImageForm
    master: int | None = None

    @property
    def whole(self) -> bool:
        return (self.folder / MANIFEST).is_file()

    @property
    def partial(self) -> Path:
        return partial_path(self.folder)

    @property
    def frames(self) -> int:
        """How many are on disk already, of a sequence that is whole or still written."""
        if self.whole:
            return self.preset.scenario.frames
        try:
            return len(os.listdir(self.partial / "images" / "robot_0_camera"))
        except OSError:
            return 0

    def sweep(self) -> None:
        """Remove what a run that was killed has left of it; what is still written stays."""
        if self.partial.exists() or self._lock.exists():
            with suppress(Locked), file_lock(self._lock):
                shutil.rmtree(self.partial, ignore_errors=True)

    @property
    def _lock(self) -> Path:
        return self.folder.with_name(f".{self.folder.name}.lock")

    def carry_out(self) -> None:
        """Write the sequence, unless it is whole by the time that nobody else writes it.

        Raises ValueError for what its world cannot hold, and where the linear algebra of this process is not kept to one thread.
        """
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
            if os.environ.get(name) != "1":
                raise ValueError(f"{name} is {os.environ.get(name)!r} in a worker, needs to be 1 from its start on (Dask's nannies see to it)")
        os.environ["LP_NUM_THREADS"] = "1"
        # A process has one watchdog and one OpenGL: workers of Dask may have several threads.
        with _one_at_a_time, file_lock(self._lock, wait=True):
            if not self.whole:
                write_recording(self._recording(), self.folder)

    def _recording(self) -> Recording:
        scenario = self.preset.scenario
        world = catalogue.build(scenario.world, scenario.stream("world"), scenario.difficulty)
        world = confined(world, self.preset.ground, scenario.stream("world/confined"))
        fixed = place_cameras(world, self.preset.views, 2 * round(0.375 * scenario.width))
        return Recording(scenario, Simulation(scenario, world=world), fixed, provenance(self.name, self.preset), self.form)


def _leave_with(master: int) -> None:
    """End this process when its master has: what nobody waits for shall not be in the way of the next run."""
    while os.getppid() == master:
        time.sleep(WATCH)
    os._exit(1)


def run_task(order: SequenceTask) -> None:
    """As Order.carry_out, in a process of its own: what a worker is sent."""
    if order.master is not None and order.master not in _followed:
        _followed.add(order.master)
        threading.Thread(target=_leave_with, args=(order.master,), daemon=True).start()
    order.carry_out()
