"""A dataset: many sequences of a preset, made on this machine or on a cluster, resumed where a run was cut off.

A dataset on disk is finished sequence by sequence: each is written under a temporary name and renamed when it is whole.
"""

from __future__ import annotations

import dataclasses
import json
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from sim.datasets.generation_worker import SequenceTask, run_task
from sim.datasets.presets import Preset
from sim.parallel.file_lock import file_lock
from sim.parallel.pool import Pool, WorkerLost
from tracker.datasets.croissant import write_croissant
from tracker.datasets.dataset_card import write_card
from tracker.io.atomic import write_text
from tracker.io.resume import check_same, holds_run
from tracker.sequence.dataset import FILE, Dataset, read_dataset
from tracker.sequence.writer import ImageForm

LARGEST_COUNT = 100_000
LOOK = 0.5
"""s between looks at how far the workers are, on a terminal ..."""
LOOK_OF_LOGS = 30
"""... and where each is kept, as in the log of a batch job."""


@dataclass(frozen=True)
class Plan:
    """count sequences of a preset into the folder `out`; the n-th has the seed of the preset's scenario + n. name: of the preset.

    workers: processes on this machine; cluster: address of a Dask scheduler to use instead, or None; it must see `out` under the same path.
    Raises ValueError for a count or a number of workers out of bounds.
    """

    name: str
    preset: Preset
    out: Path
    count: int = 1
    form: ImageForm = dataclasses.field(default_factory=lambda: ImageForm(mesh=True))
    workers: int = 1
    cluster: str | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.count <= LARGEST_COUNT:
            raise ValueError(f"count is {self.count}, needs 1 to {LARGEST_COUNT}")
        _ = self.workforce  # it checks the number

    @property
    def workforce(self) -> Pool:
        return Pool(self.workers, self.cluster)

    @property
    def dataset(self) -> Dataset:
        names = tuple(f"{self.name}-{k:05d}" for k in range(self.count))
        scenario = json.loads(self.preset.scenario.to_json())
        return Dataset(self.name, scenario, self.preset.views, dataclasses.asdict(self.form), names)

    def orders(self) -> list[SequenceTask]:
        out, scenario = self.out.resolve(), self.preset.scenario
        master = None if self.cluster else os.getpid()
        seeded = [dataclasses.replace(self.preset, scenario=dataclasses.replace(scenario, seed=scenario.seed + k)) for k in range(self.count)]
        return [SequenceTask(out / name, self.name, preset, self.form, master) for name, preset in zip(self.dataset.sequences, seeded, strict=True)]


def generate(plan: Plan) -> int:
    """Make what is not there yet; returns how many sequences that was.

    Raises ValueError where `out` holds another dataset or something else, where another run writes into it, and for what the world of the
    scenario cannot hold; OSError where a worker is lost, the disk is full or the cluster cannot be reached.
    """
    _check_free(plan)
    plan.out.mkdir(parents=True, exist_ok=True)
    with file_lock(plan.out / ".lock"):
        _check_free(plan)
        orders = plan.orders()
        for order in orders:
            order.sweep()
        begun = not (plan.out / FILE).exists()
        write_text(plan.out / FILE, plan.dataset.to_json())
        missing = [order for order in orders if not order.whole]
        if missing:
            try:
                with _shown(orders):
                    _work(plan, missing)
            finally:
                for order in missing:
                    order.sweep()
                if begun and not any(order.whole for order in orders):
                    # Nothing was made: the folder is free for another dataset.
                    (plan.out / FILE).unlink()
        lost = [order.folder for order in orders if not order.whole]
        if lost:
            raise OSError(f"{lost[0]}: was made, but is not here: the cluster must see this folder under the same path")
        write_card(plan.out)
        write_croissant(plan.out)
    return len(missing)


def _check_free(plan: Plan) -> None:
    """Raises ValueError where `out` holds anything but this dataset, of which there may be more or fewer sequences than now wanted."""
    if holds_run(plan.out, FILE, (".*",)):
        there, wanted = read_dataset(plan.out), plan.dataset
        flat = [{"preset": d.preset, "views": d.views} | d.form | d.scenario for d in (there, wanted)]
        check_same(plan.out, flat[0], flat[1], "another dataset")
        if len(there.sequences) > plan.count:
            raise ValueError(f"{plan.out}: is a dataset of {len(there.sequences)} sequences, --count is {plan.count}; ask for as many or more")


def _work(plan: Plan, orders: list[SequenceTask]) -> None:
    """Have the orders carried out, each by one call of one function in another process: here, or on the cluster."""
    try:
        for _ in plan.workforce.as_completed(run_task, ((order,) for order in orders)):
            pass
    except WorkerLost as error:
        raise OSError(f"{error}; the same command goes on from here") from None


@contextmanager
def _shown(orders: list[SequenceTask]) -> Iterator[None]:
    """How many frames of all sequences are there, and how long the rest will take; by what lies on disk, wherever it is made."""
    total = sum(order.preset.scenario.frames for order in orders)
    done = threading.Event()
    with tqdm(total=total, initial=sum(order.frames for order in orders if order.whole), desc="frames", unit="frame") as bar:

        def look() -> None:
            while not done.wait(LOOK if sys.stderr.isatty() else LOOK_OF_LOGS):
                bar.n = sum(order.frames for order in orders)
                bar.refresh()

        watching = threading.Thread(target=look, daemon=True)
        watching.start()
        try:
            yield
        finally:
            done.set()
            watching.join()
            bar.n = sum(order.frames for order in orders)
            bar.refresh()
