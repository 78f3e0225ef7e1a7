"""Who carries out calls: in order or as they come, in processes, threads or on a cluster, and what is said where one is lost."""

from __future__ import annotations

import math
import os
import threading
import time
from contextlib import suppress

import pytest

from sim.parallel.pool import ONE_THREAD, Lost, Pool


def test_processes_of_one_thread_give_results_in_order() -> None:
    assert list(Pool(2).results(math.sqrt, [(n * n,) for n in range(20)])) == list(range(20))
    # One worker is another process, too.
    assert list(Pool().results(os.getpid, [()])) != [os.getpid()]
    before = dict(os.environ)
    assert list(Pool().results(os.getenv, [(name,) for name in ONE_THREAD])) == ["1"] * len(ONE_THREAD)
    assert dict(os.environ) == before


def test_threads_give_what_is_ready_first_first() -> None:
    open_gate = threading.Event()

    def wait(number: int) -> int:
        if number == 0:
            assert open_gate.wait(10)
        return number

    found = []
    for number in Pool(2).as_they_come(wait, [(n,) for n in range(4)], threads=True):
        found.append(number)
        if len(found) == 3:
            open_gate.set()
    assert sorted(found[:3]) == [1, 2, 3]
    assert found[3] == 0
    assert list(Pool().results(os.getpid, [()] * 2, threads=True)) == [os.getpid()] * 2


def test_what_a_call_raises_and_a_process_that_ends() -> None:
    with pytest.raises(ValueError, match="math domain error"):
        list(Pool(2).results(math.sqrt, [(4,), (-1,)]))
    with pytest.raises(Lost, match="a worker was killed"):
        list(Pool(2).results(os._exit, [(3,)]))
    # And the next call finds a worker.
    assert list(Pool(2).results(math.sqrt, [(9,)])) == [3]


@pytest.mark.filterwarnings("ignore:.*still being processed")
def test_calls_that_nobody_waits_for_are_given_up() -> None:
    made = Pool(2).results(time.sleep, [(0,), (60,), (60,)])
    began = time.monotonic()
    next(made)
    with suppress(StopIteration):
        made.close()
    assert time.monotonic() - began < 30


@pytest.mark.parametrize("workers", [0, -1, 1025])
def test_numbers_of_workers_out_of_bounds(workers: int) -> None:
    with pytest.raises(ValueError, match=f"workers is {workers}, needs 1 to 1024"):
        Pool(workers)


def test_an_address_that_is_none() -> None:
    pytest.importorskip("distributed")
    with pytest.raises(ValueError, match="--cluster is 'nonsense', needs an address as tcp://HOST:PORT"):
        list(Pool(cluster="nonsense").results(math.sqrt, [(1,)]))


@pytest.mark.slow
def test_a_cluster_gives_results_in_order() -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        force = Pool(cluster=cluster.scheduler_address)
        assert list(force.results(math.sqrt, [(n * n,) for n in range(9)])) == list(range(9))
        assert sorted(force.as_they_come(math.sqrt, [(n * n,) for n in range(9)])) == list(range(9))
