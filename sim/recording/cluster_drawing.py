"""Drawing of one long sequence on a Dask cluster: the simulation runs here and hands over parts of consecutive frames.

A part is a task with the saved states of its frames. A Simulation cannot be pickled, and is not needed: a Moment has all that is drawn, in 34 kB.
Dask gives a part to another worker where one is lost. Images come back in their coded form, so that one process alone writes and notes them.
"""

from __future__ import annotations

import importlib.metadata
import math
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from itertools import islice
from typing import Any

from sim.parallel.pool import CLUSTER_LOST, WorkerLost, cluster_client, cluster_losses, drawing_alone
from sim.recording.drawing import Drawn, DrawnScene, MomentRenderer
from sim.recording.shots import Moment

SHORTEST, LONGEST = 8, 64
"""Frames of a part. A part opens a renderer, which takes as long as 4 frames of four panoramas; a longer one holds more images in memory."""
PARTS = 2
"""Parts for each thread of the cluster, where their length allows it, so that threads end at about the same time."""
AHEAD = 2
"""Parts for each thread that wait, are drawn, or wait for an earlier one."""


class ClusterDrawing:
    """Draws moments on the cluster whose scheduler has an address. It is a context manager.

    missing: the number of moments other than None. versions: package → version, which a worker must have, too.
    Raises ValueError and OSError as `cluster_client`.
    """

    def __init__(self, scene: DrawnScene, address: str, missing: int, versions: dict[str, str]) -> None:
        self._scene, self._address, self._missing, self._versions = scene, address, missing, versions
        self._stack = ExitStack()

    def __enter__(self) -> ClusterDrawing:
        self._client = self._stack.enter_context(cluster_client(self._address))
        return self

    def __exit__(self, *raised: object) -> None:
        self._stack.close()

    def draw(self, moments: Iterable[Moment | None]) -> Iterator[Drawn | None]:
        """What is drawn of the moments, in their order; None for None. Raises WorkerLost where workers are lost, and what a worker raises."""
        threads = max(1, sum(self._client.nthreads().values()))
        (scene,) = self._client.scatter([self._scene], broadcast=True, hash=False)
        waiting: deque[tuple[list[bool], Any]] = deque()
        left, length = iter(moments), part_length(self._missing, threads)
        while part := list(islice(left, length)):
            there = [moment for moment in part if moment is not None]
            future = self._client.submit(draw_part, scene, there, self._versions, pure=False) if there else None
            waiting.append(([moment is not None for moment in part], future))
            while waiting and (waiting[0][1] is None or waiting[0][1].done() or len(waiting) > AHEAD * threads):
                yield from _result(*waiting.popleft())
        while waiting:
            yield from _result(*waiting.popleft())


def part_length(missing: int, threads: int) -> int:
    """The number of frames of a part, where `missing` are drawn by a number of threads."""
    return min(LONGEST, max(SHORTEST, math.ceil(missing / (PARTS * threads))))


def draw_part(scene: DrawnScene, moments: list[Moment], versions: dict[str, str]) -> list[Drawn]:
    """Draw a part in a worker of a cluster. versions: as of ClusterDrawing.

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


def _result(wanted: list[bool], future: Any) -> Iterator[Drawn | None]:
    """Drawn for each True, None for each False. future: of what is drawn, or None."""
    losses: tuple[type[Exception], ...] = (TimeoutError, *cluster_losses())
    try:
        drawn = iter([] if future is None else future.result())
    except losses:
        raise WorkerLost(f"{CLUSTER_LOST}; the same command resumes") from None
    for one in wanted:
        yield next(drawn) if one else None
