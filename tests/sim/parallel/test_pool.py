"""Parallel calls: their order, in processes, threads and on a cluster, and the errors of lost workers."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from sim.parallel import pool as pool_module
from sim.parallel.pool import ONE_THREAD, Pool, WorkerLost


def test_processes_of_one_thread_give_results_in_order() -> None:
    assert list(Pool(2).results(math.sqrt, [(n * n,) for n in range(20)])) == list(range(20))
    # One worker is a process of its own, too.
    assert list(Pool().results(os.getpid, [()])) != [os.getpid()]
    before = dict(os.environ)
    assert list(Pool().results(os.getenv, [(name,) for name in ONE_THREAD])) == ["1"] * len(ONE_THREAD)
    assert dict(os.environ) == before


def test_threads_return_results_in_order_of_completion() -> None:
    open_gate = threading.Event()

    def wait(number: int) -> int:
        if number == 0:
            assert open_gate.wait(10)
        return number

    found = []
    for number in Pool(2).as_completed(wait, [(n,) for n in range(4)], threads=True):
        found.append(number)
        if len(found) == 3:
            open_gate.set()
    assert sorted(found[:3]) == [1, 2, 3]
    assert found[3] == 0
    assert list(Pool().results(os.getpid, [()] * 2, threads=True)) == [os.getpid()] * 2


def test_errors_of_calls_and_killed_workers_are_raised() -> None:
    with pytest.raises(ValueError, match="math domain error"):
        list(Pool(2).results(math.sqrt, [(4,), (-1,)]))
    with pytest.raises(WorkerLost, match="a worker was killed"):
        list(Pool(2).results(os._exit, [(3,)]))
    # The next call gets a new worker.
    assert list(Pool(2).results(math.sqrt, [(9,)])) == [3]


def test_closing_the_generator_cancels_pending_calls() -> None:
    made = Pool(2).results(time.sleep, [(0,), (60,), (60,)])
    began = time.monotonic()
    next(made)
    made.close()
    assert time.monotonic() - began < 30


@pytest.mark.parametrize("workers", [0, -1, 1025])
def test_a_number_of_workers_out_of_bounds_is_refused(workers: int) -> None:
    with pytest.raises(ValueError, match=f"workers is {workers}, needs 1 to 1024"):
        Pool(workers)


def test_an_invalid_cluster_address_is_refused() -> None:
    pytest.importorskip("distributed")
    with pytest.raises(ValueError, match="--cluster is 'nonsense', needs an address as tcp://HOST:PORT"):
        list(Pool(cluster="nonsense").results(math.sqrt, [(1,)]))


@pytest.mark.soak
def test_a_cluster_gives_results_in_order(cluster: Any) -> None:
    pool = Pool(cluster=cluster.scheduler_address)
    assert list(pool.results(math.sqrt, [(n * n,) for n in range(9)])) == list(range(9))
    assert sorted(pool.as_completed(math.sqrt, [(n * n,) for n in range(9)])) == list(range(9))


@pytest.mark.soak
def test_a_cluster_without_workers_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(pool_module, "CONNECT_TIMEOUT", 1)
    refused = pytest.raises(OSError, match=r"this cluster has no worker after 1 s; `dask worker tcp://")
    with distributed.LocalCluster(n_workers=0, dashboard_address=None) as cluster, refused:
        list(Pool(cluster=cluster.scheduler_address).results(math.sqrt, [(1,)]))


@pytest.mark.soak
def test_a_cluster_of_one_thread_is_used_and_its_loss_is_one_error(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    distributed = pytest.importorskip("distributed")
    where = ["--scheduler-file", str(tmp_path / "scheduler.json"), "--no-dashboard"]
    # Their logs go elsewhere, so that what is captured is from this process alone.
    dask = [
        subprocess.Popen([sys.executable, "-m", f"distributed.cli.dask_{role}", *where, *more], stderr=subprocess.DEVNULL)
        for role, more in (("scheduler", ["--port", "0"]), ("worker", ["--nworkers", "1", "--nthreads", "1"]))
    ]
    try:
        with distributed.Client(scheduler_file=where[1]) as client:
            client.wait_for_workers(1)
            address = client.scheduler.address
        assert os.getpid() not in Pool(cluster=address).results(os.getpid, [(), ()])
        threading.Timer(1, dask[0].kill).start()
        with pytest.raises(WorkerLost, match="the scheduler or workers of the cluster were lost"):
            list(Pool(cluster=address).results(time.sleep, [(60,)]))
    finally:
        for process in reversed(dask):
            process.kill()
            process.wait()
    assert capfd.readouterr().err == ""
