"""Drawing of the moments of one sequence by processes of this machine or by a Dask cluster, while the simulation runs ahead.

A Simulation cannot be pickled, and is not needed: a Moment has all that is drawn, in 34 kB. Images come back in their coded form, so that one
process alone writes and notes them.
"""

from __future__ import annotations

import importlib.metadata
import math
import pickle
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from sim.parallel.pool import cluster, drawing_alone, losses, processes
from sim.recording.drawing import Drawn, DrawnScene, MomentRenderer
from sim.recording.shots import Moment
from sim.rendering.gl_context import choose_gl

AHEAD = 3
"""Parts for each process that wait, are drawn, or wait for an earlier one. A part is one moment here, and several of them on a cluster."""
SHORTEST, LONGEST = 8, 64
"""Frames of a part. A part opens a renderer, which takes as long as 4 frames of four panoramas; a longer one holds more images in memory."""
PARTS = 2
"""Parts for each thread of the cluster, where their length allows it, so that threads end at about the same time."""
_renderers: dict[Path, MomentRenderer] = {}


@dataclass(frozen=True, eq=False)
class DrawingWorkers:
    """A number of processes that draw moments of one scene, which is written into a folder."""

    executor: Executor
    count: int
    folder: Path

    def draw(self, scene: DrawnScene, moments: Iterable[Moment | None]) -> Iterator[Drawn | None]:
        """What is drawn of the moments, in their order; None for None. Raises WorkerLost where a worker ends, and what a worker raises."""
        file = self.folder / "scene"
        file.write_bytes(pickle.dumps(scene, pickle.HIGHEST_PROTOCOL))
        return drawn_in_order(([moment] for moment in moments), lambda part: self.executor.submit(_draw, file, part), AHEAD * self.count)


@contextmanager
def drawing_workers(count: int) -> Iterator[DrawingWorkers | None]:
    """Workers during this context; None for one, since the process of the caller draws then.

    They start with it, so that they import what they need while the scene is built.
    """
    if count < 2:
        yield None
        return
    choose_gl()
    with processes(count, __name__) as executor, tempfile.TemporaryDirectory(prefix="pilsim-") as folder:
        yield DrawingWorkers(executor, count, Path(folder))


def _draw(scene: Path, moments: list[Moment]) -> list[Drawn]:
    """Draw a part in a process of this machine, whose renderer stays open."""
    if scene not in _renderers:
        _renderers[scene] = MomentRenderer(pickle.loads(scene.read_bytes()))
    return [_renderers[scene].draw(moment) for moment in moments]


def draw_on_cluster(
    scene: DrawnScene, moments: Iterable[Moment | None], missing: int, address: str, versions: dict[str, str]
) -> Iterator[Drawn | None]:
    """As DrawingWorkers.draw, by the cluster whose scheduler has an address. Dask gives a part to another worker where one is lost.

    missing: the number of moments other than None. versions: package → version, which a worker must have, too.
    Raises ValueError and OSError as `cluster`.
    """
    with cluster(address) as (client, threads):
        (known,) = client.scatter([scene], broadcast=True, hash=False)
        executor, left, length = client.get_executor(pure=False), iter(moments), part_length(missing, threads)
        parts = iter(lambda: list(islice(left, length)), [])
        yield from drawn_in_order(parts, lambda part: executor.submit(draw_part, known, part, versions), AHEAD * threads)


def part_length(missing: int, threads: int) -> int:
    """The number of frames of a part, where `missing` are drawn by a number of threads."""
    return min(LONGEST, max(SHORTEST, math.ceil(missing / (PARTS * threads))))


def draw_part(scene: DrawnScene, moments: list[Moment], versions: dict[str, str]) -> list[Drawn]:
    """Draw a part in a worker of a cluster. versions: as of draw_on_cluster.

    Raises ValueError where the worker has other versions, or several threads of linear algebra.
    """
    check_versions(versions)
    with drawing_alone(), MomentRenderer(scene) as renderer:
        return [renderer.draw(moment) for moment in moments]


def check_versions(needed: dict[str, str]) -> None:
    """Raises ValueError where a package of this process has another version. needed: package → version."""
    for name, version in needed.items():
        own = importlib.metadata.version(name)
        if own != version:
            raise ValueError(f"{name} is {own} in a worker of the cluster, needs {version} as here")


def drawn_in_order(
    parts: Iterable[list[Moment | None]], submit: Callable[[list[Moment]], Future[list[Drawn]]], most: int
) -> Iterator[Drawn | None]:
    """What is drawn of parts of moments, in their order; None for None. At most `most` parts wait, are drawn, or wait for an earlier one."""
    waiting: deque[tuple[list[Moment | None], Future[list[Drawn]] | None]] = deque()
    with losses():
        for part in parts:
            there = [moment for moment in part if moment is not None]
            waiting.append((part, submit(there) if there else None))
            while waiting and (waiting[0][1] is None or waiting[0][1].done() or len(waiting) > most):
                yield from _in_place(*waiting.popleft())
        while waiting:
            yield from _in_place(*waiting.popleft())


def _in_place(part: list[Moment | None], future: Future[list[Drawn]] | None) -> Iterator[Drawn | None]:
    drawn = iter([] if future is None else future.result())
    for moment in part:
        yield None if moment is None else next(drawn)
