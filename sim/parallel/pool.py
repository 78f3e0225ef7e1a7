"""Calls that others carry out: processes or threads of this machine, or a Dask cluster; each is handed one at a time."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

ONE_THREAD = ("LP_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""What bounds the threads of the software renderer and of linear algebra: sums in another order are other numbers."""
LARGEST = 1024
CONNECTING = 15
"""s to reach the scheduler of a cluster."""


class Lost(OSError):  # noqa: N818
    """A worker ended in the middle of a call."""


@dataclass(frozen=True)
class Pool:
    """workers: processes (or threads) of this machine; cluster: address of a Dask scheduler to use instead, or None.

    Raises ValueError for a number of workers out of bounds.
    """

    workers: int = 1
    cluster: str | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.workers <= LARGEST:
            raise ValueError(f"workers is {self.workers}, needs 1 to {LARGEST}")

    def results(self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]], threads: bool = False) -> Iterator[Any]:
        """What function(*call) gives for each of the calls, in their order.

        On this machine in other processes, of one thread of linear algebra each, even where there is one worker; threads: in threads of this
        process, for calls that wait. Until the last result was taken, whatever process is started has one thread. Raises what a call raises, Lost
        where a process ends in the middle of one, ValueError where Dask is missing or the address is none, OSError where no scheduler is there.
        """
        return self._made(function, calls, threads, "generator")

    def as_they_come(self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]], threads: bool = False) -> Iterator[Any]:
        """As `results`, in the order in which they are ready."""
        return self._made(function, calls, threads, "generator_unordered")

    def _made(self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]], threads: bool, order: str) -> Iterator[Any]:
        from joblib import Parallel, delayed
        from joblib.externals.loky.process_executor import TerminatedWorkerError

        here = _threads(self.workers) if threads else _processes(self.workers)
        with here if self.cluster is None else _cluster(self.cluster) as (jobs, under_way):
            try:
                # One at a time a worker: nothing is queued that a dead master would leave behind.
                yield from Parallel(n_jobs=jobs, pre_dispatch=under_way, batch_size=1, return_as=order)(delayed(function)(*call) for call in calls)
            except TerminatedWorkerError:
                raise Lost("a worker was killed, perhaps for want of memory") from None


@contextmanager
def _threads(workers: int) -> Iterator[tuple[int, int]]:
    """During this context joblib's calls go to threads; gives its n_jobs, and how many calls to have under way."""
    from joblib import parallel_config

    with parallel_config("threading"):
        yield workers, workers


@contextmanager
def _processes(workers: int) -> Iterator[tuple[int, int]]:
    """As _threads, by processes; of one job joblib would make no process, so of one it is told that there are two."""
    from joblib import parallel_config
    from joblib.externals.loky import get_reusable_executor

    with _pinned(), parallel_config("loky", inner_max_num_threads=1):
        try:
            yield max(2, workers), workers
        finally:
            get_reusable_executor(reuse=True).shutdown(wait=True, kill_workers=True)


@contextmanager
def _cluster(address: str) -> Iterator[tuple[int, int]]:
    """As _threads, by the workers of a Dask cluster, two calls under way for each of their threads."""
    from joblib import parallel_config

    try:
        from distributed import Client
    except ImportError:
        raise ValueError("--cluster needs Dask: pip install 'pilsim[cluster]'") from None
    try:
        client = Client(address, timeout=CONNECTING, set_as_default=True)
    except (ValueError, TypeError) as error:
        raise ValueError(f"--cluster is {address!r}, needs an address as tcp://HOST:PORT ({error})") from None
    with client, parallel_config("dask", wait_for_workers_timeout=CONNECTING):
        under_way = max(1, 2 * sum(client.nthreads().values()))
        yield max(2, under_way), under_way


@contextmanager
def _pinned() -> Iterator[None]:
    """Processes that are started during this context compute and draw with one thread each."""
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
