"""Parallel calls in processes or threads of this machine, or on a Dask cluster."""

from __future__ import annotations

import logging
import os
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from distributed import Client

ONE_THREAD = ("LP_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Environment variables that limit the threads of the software renderer and of linear algebra.

With more threads, sums are taken in another order and results differ.
"""
MAX_WORKERS = 1024
UNUSED = r"\d+ tasks (have been successfully executed|which were still being processed)"
"""How joblib's warning begins."""
CONNECT_TIMEOUT = 15
"""s to wait for the scheduler of a cluster."""
DASK_LOGGERS = ("distributed", "distributed.client")
"""Loggers of Dask, each of which has a level and a handler of its own."""
CLUSTER_LOST = "the scheduler or workers of the cluster were lost, perhaps because memory ran out"
_one_at_a_time = threading.Lock()


def usable_cores() -> int:
    """The number of cores that this process may use, MAX_WORKERS at most."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, MAX_WORKERS)


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
        threads: calls run in threads of this process, which suits calls that wait. Until the last result is taken, every process that is
        started has one thread.

        Raises what a call raises. Raises WorkerLost where a process ends during a call or the cluster is lost. Raises ValueError where Dask is
        missing or the address is invalid, and OSError where no scheduler answers or it has no worker.
        """
        return self._run(function, calls, threads, "generator")

    def as_completed(self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]], threads: bool = False) -> Iterator[Any]:
        """As `results`, in the order in which the calls end."""
        return self._run(function, calls, threads, "generator_unordered")

    def _run(self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]], threads: bool, order: str) -> Iterator[Any]:
        from joblib import Parallel, delayed
        from joblib.externals.loky.process_executor import TerminatedWorkerError

        # joblib warns of calls whose results nobody takes, which is so after each interruption.
        warnings.filterwarnings("ignore", UNUSED, UserWarning)
        local = _threads(self.workers) if threads else _processes(self.workers)
        with local if self.cluster is None else _cluster(self.cluster) as (jobs, in_progress):
            losses = () if self.cluster is None else cluster_losses()
            try:
                # One call per worker: a queue would outlive a main process that was killed.
                yield from Parallel(n_jobs=jobs, pre_dispatch=in_progress, batch_size=1, return_as=order)(delayed(function)(*call) for call in calls)
            except TerminatedWorkerError:
                raise WorkerLost("a worker was killed, perhaps because memory ran out") from None
            except losses:
                raise WorkerLost(CLUSTER_LOST) from None


@contextmanager
def _threads(workers: int) -> Iterator[tuple[int, int]]:
    """joblib runs calls in threads during this context. Yields joblib's n_jobs and the number of calls in progress at once."""
    from joblib import parallel_config

    with parallel_config("threading"):
        yield workers, workers


@contextmanager
def _processes(workers: int) -> Iterator[tuple[int, int]]:
    """As `_threads`, with processes. joblib makes no process for one job, so n_jobs is at least 2."""
    from joblib import parallel_config
    from joblib.externals.loky import get_reusable_executor

    with _pinned(), parallel_config("loky", inner_max_num_threads=1):
        try:
            yield max(2, workers), workers
        finally:
            get_reusable_executor(reuse=True).shutdown(wait=True, kill_workers=True)


def cluster_client(address: str) -> Client:
    """A connection to a Dask cluster, to be used as a context. Raises ValueError where Dask is missing or the address is invalid, and OSError where
    no scheduler answers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise ValueError("--cluster needs Dask: pip install 'pilsim[cluster]'") from None
    # Dask logs a traceback where its scheduler is lost, beside the error that it raises.
    for name in DASK_LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        return Client(address, timeout=CONNECT_TIMEOUT, set_as_default=True)
    except (ValueError, TypeError) as error:
        raise ValueError(f"--cluster is {address!r}, needs an address as tcp://HOST:PORT ({error})") from None


def cluster_losses() -> tuple[type[Exception], ...]:
    """What Dask raises where the scheduler of a cluster, or too many workers one after another, are lost."""
    from distributed import KilledWorker
    from distributed.comm.core import CommClosedError

    return KilledWorker, CancelledError, CommClosedError


@contextmanager
def drawing_alone() -> Iterator[None]:
    """For drawing in a worker of a cluster, which may have several threads: a process has one watchdog and one OpenGL context.

    Raises ValueError where the linear algebra of this process has several threads.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        if os.environ.get(name) != "1":
            raise ValueError(f"{name} is {os.environ.get(name)!r} in a worker, needs to be 1 at its start (Dask's nannies set it)")
    os.environ["LP_NUM_THREADS"] = "1"
    with _one_at_a_time:
        yield


@contextmanager
def _cluster(address: str) -> Iterator[tuple[int, int]]:
    """As `_threads`, with the workers of a Dask cluster and two calls in progress per thread."""
    from joblib import parallel_config

    with cluster_client(address) as client, parallel_config(_dask_backend(client, address)):
        in_progress = max(1, 2 * sum(client.nthreads().values()))
        yield max(2, in_progress), in_progress


def _dask_backend(client: Client, address: str) -> Any:
    """joblib's backend for a cluster. joblib itself would run the calls here where the cluster has one thread."""
    from joblib._dask import DaskDistributedBackend

    class ClusterBackend(DaskDistributedBackend):
        def effective_n_jobs(self, n_jobs: int) -> int:
            try:
                return max(2, int(super().effective_n_jobs(n_jobs)))
            except TimeoutError:
                raise OSError(f"{address}: this cluster has no worker after {CONNECT_TIMEOUT} s; `dask worker {address}` starts one") from None

    return ClusterBackend(client=client, wait_for_workers_timeout=CONNECT_TIMEOUT)


@contextmanager
def _pinned() -> Iterator[None]:
    """Processes that are started during this context compute and render with one thread each."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ |= dict.fromkeys(ONE_THREAD, "1")
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
