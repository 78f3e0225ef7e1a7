"""Worker processes that draw the moments of one sequence while the simulation runs ahead.

Scene, moments and results are pickled between processes of one program.
A worker whose program was killed reads the end of its socket, and ends.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, Pipe
from queue import SimpleQueue

from sim.parallel.pool import ONE_THREAD, WorkerLost
from sim.recording.drawing import Drawn, DrawnScene, MomentRenderer
from sim.recording.shots import Moment
from sim.rendering.gl_context import choose_gl

AHEAD = 3
"""Moments for each worker that wait, are drawn, or wait for an earlier one."""
START = """
import signal, sys
signal.signal(signal.SIGINT, signal.SIG_DFL)
from multiprocessing.connection import Connection
from sim.recording.drawing_workers import serve
serve(Connection(int(sys.argv[1])))
"""
"""Program of a worker. The terminal's interrupt reaches all processes; a worker ends by it without a word, before its imports, too."""


class DrawingWorkers:
    """Draws moments of one scene in `count` processes. It is a context manager, which ends them.

    They start with it, so that they import what they need while the scene is built.
    """

    def __init__(self, count: int) -> None:
        choose_gl()
        self._processes: list[subprocess.Popen[bytes]] = []
        self._connections: list[Connection] = []
        self._idle: SimpleQueue[tuple[Connection, bool]] = SimpleQueue()
        self._count = count
        self._threads = ThreadPoolExecutor(count)

    def __enter__(self) -> DrawingWorkers:
        environment = os.environ | dict.fromkeys(ONE_THREAD, "1") | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)}
        for _ in range(self._count):
            ours, theirs = Pipe()
            with theirs:
                command = [sys.executable, "-c", START, str(theirs.fileno())]
                process = subprocess.Popen(command, pass_fds=[theirs.fileno()], env=environment, stdin=subprocess.DEVNULL)
            self._processes.append(process)
            self._connections.append(ours)
            self._idle.put((ours, True))
        return self

    def __exit__(self, *raised: object) -> None:
        for process in self._processes:
            process.kill()
        for process in self._processes:
            process.wait()
        self._threads.shutdown(cancel_futures=True)
        for connection in self._connections:
            connection.close()

    def draw(self, scene: DrawnScene, moments: Iterable[Moment | None]) -> Iterator[Drawn | None]:
        """What is drawn of the moments, in their order; None for None. Raises WorkerLost where a worker ends, and what a worker raises."""
        waiting: deque[Future[Drawn | None]] = deque()
        for moment in moments:
            waiting.append(self._threads.submit(self._call, scene, moment))
            while waiting and (waiting[0].done() or len(waiting) > AHEAD * self._count):
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()

    def _call(self, scene: DrawnScene, moment: Moment | None) -> Drawn | None:
        if moment is None:
            return None
        connection, new = self._idle.get()
        try:
            if new:
                connection.send(scene)
            connection.send(moment)
            answer = connection.recv()
        except (EOFError, OSError):
            raise WorkerLost("a drawing worker was killed, perhaps because memory ran out; the same command resumes") from None
        finally:
            self._idle.put((connection, False))
        if isinstance(answer, Exception):
            raise answer
        assert isinstance(answer, Drawn)
        return answer


@contextmanager
def drawing_workers(count: int) -> Iterator[DrawingWorkers | None]:
    """Workers during this context; None for one, since the process of the caller draws then."""
    if count < 2:
        yield None
        return
    with DrawingWorkers(count) as workers:
        yield workers


def serve(connection: Connection) -> None:
    """Draw the moments that come through a connection until it ends."""
    with suppress(EOFError, ConnectionError):
        scene = connection.recv()
        try:
            renderer = MomentRenderer(scene)
        except Exception as error:
            connection.recv()
            connection.send(error)
            return
        with renderer:
            while True:
                moment = connection.recv()
                try:
                    answer: Drawn | Exception = renderer.draw(moment)
                except Exception as error:
                    answer = error
                connection.send(answer)

