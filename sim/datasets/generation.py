"""Generation of datasets: many sequences of a preset, made on this machine or on a cluster, and resumed after an interruption.

Each sequence is written under a temporary name, and renamed when it is complete. The same task gives the same bytes in any process.
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from sim.datasets.fixed_cameras import corner_cameras, place_cameras
from sim.datasets.presets import Preset, confine, provenance
from sim.parallel.pool import Pool, cluster, drawing_alone, usable_cores
from sim.recording.drawing import DrawingWorkers, drawing_workers
from sim.recording.frame_journal import NAME as JOURNAL
from sim.recording.record import SimulatedSequence, write_sequence
from sim.recording.tracker_setup import cameras_of
from sim.scenario import OPTIONAL
from sim.simulation.simulation import Simulation, furnished
from tracker.datasets.croissant import write_croissant
from tracker.datasets.dataset_card import write_card
from tracker.io.atomic import partial_path, write_text
from tracker.io.file_lock import Locked, file_lock, folder_lock
from tracker.io.progress import progress_bar
from tracker.io.resume import check_same, holds_run
from tracker.sequence.dataset import FILE, MANIFEST, Dataset, read_dataset
from tracker.sequence.writer import ImageForm
from worlds import catalogue

MAX_COUNT = 100_000


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


@dataclass(frozen=True)
class Plan:
    """A dataset to generate: `count` sequences of a preset in the folder `out`. The n-th has the seed of the preset's scenario + n.

    name: of the preset. form: of the images. workers: number of processes that draw on this machine. cluster: address of a Dask scheduler, or None.
    The cluster must see `out` under the same path. Raises ValueError for a count or a number of workers out of bounds.
    """

    name: str
    preset: Preset
    out: Path
    count: int = 1
    form: ImageForm = dataclasses.field(default_factory=lambda: ImageForm(mesh=True))
    workers: int = 1
    cluster: str | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.count <= MAX_COUNT:
            raise ValueError(f"count is {self.count}, needs 1 to {MAX_COUNT}")
        _ = self.pool  # checks the number of workers

    @property
    def pool(self) -> Pool:
        return Pool(self.workers, self.cluster)

    @property
    def dataset(self) -> Dataset:
        names = tuple(f"{self.name}-{k:05d}" for k in range(self.count))
        scenario = json.loads(self.preset.scenario.to_json())
        return Dataset(self.name, scenario, self.preset.views, dataclasses.asdict(self.form), names)

    def tasks(self) -> list[SequenceTask]:
        out, scenario = self.out.resolve(), self.preset.scenario
        seeded = [dataclasses.replace(self.preset, scenario=dataclasses.replace(scenario, seed=scenario.seed + k)) for k in range(self.count)]
        return [SequenceTask(out / name, self.name, preset, self.form) for name, preset in zip(self.dataset.sequences, seeded, strict=True)]


def generate(plan: Plan) -> int:
    """Make the missing sequences, and return their number.

    Raises ValueError where `out` holds another dataset or other files, or another run writes into it. Raises ValueError for a scenario that
    does not fit into its world. Raises OSError where a worker is lost, the disk is full, or the cluster does not answer.
    """
    _check_free(plan)
    with folder_lock(plan.out):
        _check_free(plan)
        tasks = plan.tasks()
        for task in tasks:
            task.remove_leftovers(resumable=True)
        new = not (plan.out / FILE).exists()
        write_text(plan.out / FILE, plan.dataset.to_json())
        missing = [task for task in tasks if not task.complete]
        if missing:
            _make(plan, tasks, missing, new)
        lost = [task.folder for task in tasks if not task.complete]
        if lost:
            raise OSError(f"{lost[0]}: was made by the cluster, but is not here: the cluster must see this folder under the same path")
        write_card(plan.out)
        write_croissant(plan.out)
    return len(missing)


def _make(plan: Plan, tasks: list[SequenceTask], missing: list[SequenceTask], new: bool) -> None:
    """Make the missing sequences of all tasks. new: whether the dataset is new."""
    resumable = False
    try:
        with _progress(tasks):
            _run(plan, missing)
    except (OSError, KeyboardInterrupt):
        # The next run resumes the sequences that could not be finished.
        resumable = True
        raise
    finally:
        for task in missing:
            task.remove_leftovers(resumable)
        if new and not any(task.complete for task in tasks):
            # No sequence was made: the folder stays free for another dataset.
            (plan.out / FILE).unlink(missing_ok=True)


def _check_free(plan: Plan) -> None:
    """Raises ValueError where `out` holds other files than this dataset, or more sequences of it than the plan has."""
    if holds_run(plan.out, FILE, (".*",)):
        existing, planned = read_dataset(plan.out), plan.dataset
        # A scenario omits optional fields that are off: a missing field counts as None, so that it differs from a given one.
        absent = dict.fromkeys(OPTIONAL)
        flat = [absent | {"preset": d.preset, "views": d.views} | d.form | d.scenario for d in (existing, planned)]
        check_same(plan.out, flat[0], flat[1], "another dataset")
        if len(existing.sequences) > plan.count:
            raise ValueError(f"{plan.out}: is a dataset of {len(existing.sequences)} sequences, --count is {plan.count}; ask for as many or more")


def _run(plan: Plan, tasks: list[SequenceTask]) -> None:
    """Run the tasks in other processes, on this machine or on the cluster.

    Workers without a sequence of their own draw for the others. Sequences are then simulated on this machine, and a cluster draws parts of them.
    """
    pool = plan.pool
    if plan.cluster is None:
        tasks = [dataclasses.replace(task, workers=max(1, plan.workers // len(tasks))) for task in tasks]
    else:
        with cluster(plan.cluster) as (_, threads):
            pass
        if len(tasks) < threads:
            pool = Pool(min(len(tasks), usable_cores()))
            tasks = [dataclasses.replace(task, cluster=plan.cluster) for task in tasks]
    for _ in pool.as_completed(SequenceTask.run, ((task,) for task in tasks)):
        pass


@contextmanager
def _progress(tasks: list[SequenceTask]) -> Iterator[None]:
    """Show a progress bar of the frames on disk during this context. It works for local workers and for clusters."""
    total = sum(task.preset.scenario.frames for task in tasks)
    done = threading.Event()
    with progress_bar(total=total, initial=sum(task.frames for task in tasks if task.complete), desc="frames", unit="frame") as bar:

        def refresh() -> None:
            while not done.wait(bar.period):
                bar.n = sum(task.frames for task in tasks)
                bar.refresh()

        thread = threading.Thread(target=refresh, daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()
            bar.n = sum(task.frames for task in tasks)
            bar.refresh()
