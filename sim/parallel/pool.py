"""Parallel calls in processes or threads of this machine, or on a Dask cluster: executors as of concurrent.futures."""

from __future__ import annotations

import importlib
import logging
import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from distributed import Client

ONE_THREAD = ("LP_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Environment variables that limit the threads of the software renderer and of linear algebra.

With more threads, sums are taken in another order and results differ.
"""
MAX_WORKERS = 1024
CONNECT_TIMEOUT = 15
"""s to wait for the scheduler of a cluster, and for its first worker."""
CHECK_INTERVAL = 0.3
"""Time between checks whether the parent process is alive, s."""
DASK_LOGGERS = ("distributed", "distributed.client")
"""Loggers of Dask, each of which has a level and a handler of its own."""
_one_at_a_time = threading.Lock()


def usable_cores() -> int:
    """The number of cores that this process may use, MAX_WORKERS at most: of the machine, and of the quota of a container."""
    from joblib import cpu_count

    return min(cpu_count(), MAX_WORKERS)


class WorkerLost(OSError):  # noqa: N818
    """A worker ended in the middle of a call."""


@dataclass(frozen=True)
class Pool:
    """A number of workers (processes or threads) of this machine, or a Dask cluster.

    cluster: address of a Dask scheduler, which replaces the local workers, or None. Raises ValueError for a number of workers out of bounds.
    """

    workers: int = 1
    cluster: str | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.workers <= MAX_WORKERS:
            raise ValueError(f"workers is {self.workers}, needs 1 to {MAX_WORKERS}")

    def results(self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]], threads: bool = False) -> Iterator[Any]:
        """The results of function(*call) for each of the calls, in the order of the calls.

        Local calls run in other processes, even with one worker. Each process has one thread of linear algebra.
        threads: calls run in threads of this process, which suits calls that wait.

        Raises what a call raises. Raises WorkerLost where a process ends during a call or the cluster is lost. Raises ValueError where Dask is
        missing or the address is invalid, and OSError where no scheduler answers or it has no worker.
        """
        early: dict[int, Any] = {}
        expected = 0
        for number, result in self._ended(function, calls, threads):
            early[number] = result
            while expected in early:
                yield early.pop(expected)
                expected += 1

    def as_completed(self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]], threads: bool = False) -> Iterator[Any]:
        """As `results`, in the order in which the calls end."""
        return (result for _, result in self._ended(function, calls, threads))

    def _ended(self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]], threads: bool) -> Iterator[tuple[int, Any]]:
        """Number and result of each call, as they end."""
        with losses(), self.executor(threads) as (executor, most):
            yield from ended(executor, most, function, calls)

    @contextmanager
    def executor(self, threads: bool = False) -> Iterator[tuple[Executor, int]]:
        """An executor, and the number of calls in progress at once: two per thread of a cluster."""
        if self.cluster is not None:
            with cluster(self.cluster) as (client, number):
                yield client.get_executor(pure=False), 2 * number
        elif threads:
            with ThreadPoolExecutor(self.workers) as executor:
                yield executor, self.workers
        else:
            with processes(self.workers) as executor:
                yield executor, self.workers


def ended(executor: Executor, most: int, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
    """Number and result of each call, as they end. At most `most` are in progress: queued calls would outlive a killed main process."""
    pending: dict[Future[Any], int] = {}
    for number, call in enumerate(calls):
        pending[executor.submit(function, *call)] = number
        while len(pending) >= most:
            yield from _taken(pending)
    while pending:
        yield from _taken(pending)


def _taken(pending: dict[Future[Any], int]) -> Iterator[tuple[int, Any]]:
    for future in wait(pending, return_when=FIRST_COMPLETED).done:
        yield pending.pop(future), future.result()


@contextmanager
def processes(workers: int, module: str = __name__) -> Iterator[Executor]:
    """Processes of one thread of linear algebra each, which import `module` at their start and are killed at the end.

    What they print goes to standard error. They end with this process, whose Ctrl-C they do not see.
    """
    from joblib.externals.loky.process_executor import ProcessPoolExecutor

    # A Dask worker is a daemon, which multiprocessing forbids to start processes.
    multiprocessing.current_process().daemon = False
    # A process whose memory has grown is replaced. No work is lost, so users need no warning.
    warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
    executor = ProcessPoolExecutor(workers, initializer=_begin, initargs=(os.getpid(), module), env=dict.fromkeys(ONE_THREAD, "1"))
    try:
        with _deaf():
            executor.submit(os.getpid)  # All processes are started.
        yield executor
    finally:
        executor.shutdown(wait=True, kill_workers=True)


@contextmanager
def _deaf() -> Iterator[None]:
    """Processes that are started during this context do not see Ctrl-C, which a terminal sends to all processes (POSIX)."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(parent: int, module: str) -> None:
    """Prepare a process."""
    with suppress(OSError):
        os.dup2(2, 1)
    threading.Thread(target=_exit_with_parent, args=(parent,), daemon=True).start()
    importlib.import_module(module)


def _exit_with_parent(parent: int) -> None:
    """End this process when its parent has ended. Otherwise it would hold locks against the next run."""
    while os.getppid() == parent:
        time.sleep(CHECK_INTERVAL)
    os._exit(1)


@contextmanager
def losses() -> Iterator[None]:
    """Raise WorkerLost for processes and clusters that are lost during this context."""
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    try:
        yield
    except TerminatedWorkerError:
        raise WorkerLost("a worker was killed, perhaps because memory ran out; repeat the command") from None
    except _cluster_losses():
        raise WorkerLost("the scheduler or workers of the cluster were lost, perhaps because memory ran out; repeat the command") from None


def _cluster_losses() -> tuple[type[Exception], ...]:
    """What Dask raises where the scheduler of a cluster, or too many workers one after another, are lost."""
    if "distributed" not in sys.modules:
        return ()
    from distributed import KilledWorker
    from distributed.comm.core import CommClosedError

    return KilledWorker, CancelledError, CommClosedError


@contextmanager
def cluster(address: str) -> Iterator[tuple[Client, int]]:
    """A connection to a Dask cluster with workers, and the number of their threads.

    Raises ValueError where Dask is missing or the address is invalid, and OSError where no scheduler answers or it has no worker.
    """
    try:
        from distributed import Client
    except ImportError:
        raise ValueError("--cluster needs Dask: pip install 'pilsim[cluster]'") from None
    # Dask logs a traceback where its scheduler is lost, beside the error that it raises.
    for name in DASK_LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=CONNECT_TIMEOUT, set_as_default=True)
    except (ValueError, TypeError) as error:
        raise ValueError(f"--cluster is {address!r}, needs an address as tcp://HOST:PORT ({error})") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_TIMEOUT)
        except TimeoutError:
            raise OSError(f"{address}: this cluster has no worker after {CONNECT_TIMEOUT} s; `dask worker {address}` starts one") from None
        yield client, max(1, sum(client.nthreads().values()))


@contextmanager
def drawing_alone() -> Iterator[None]:
    """Exclusive drawing in a worker of a cluster, which may have several threads: a process has one watchdog and one OpenGL context.

    Raises ValueError where the linear algebra of this process has several threads.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        if os.environ.get(name) != "1":
            raise ValueError(f"{name} is {os.environ.get(name)!r} in a worker, needs to be 1 at its start (Dask's nannies set it)")
    os.environ["LP_NUM_THREADS"] = "1"
    with _one_at_a_time:
        yield
