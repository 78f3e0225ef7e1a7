"""What all tests share: the folder of real data, and the count of skipped tests."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from zlib import crc32

import pytest

DATA = Path(os.environ.get("PILSIM_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


@pytest.fixture(scope="session")
def data() -> Callable[..., Path]:
    """`data("pets2009", "calibration")` → that path in the folder of real data; the test is skipped where it is absent."""

    def find(*parts: str) -> Path:
        if not DATA.is_dir():
            pytest.skip(f"needs the folder of real data, {DATA} is none (set PILSIM_DATA)")
        path = DATA.joinpath(*parts)
        if not path.exists():
            pytest.skip(f"real data not found: {path} (set PILSIM_DATA to the folder that holds it)")
        return path

    return find


@pytest.fixture(scope="session")
def dask_cluster() -> Iterator[Any]:
    """A Dask cluster of two workers of one thread."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster


@pytest.fixture
def cluster(dask_cluster: Any) -> Any:
    """The cluster of all tests, with both workers: Dask starts another one where a test killed one."""
    with dask_cluster.get_client() as client:
        client.wait_for_workers(2)
    return dask_cluster


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("pilsim")
    group.addoption("--most-skips", type=int, metavar="N", help="fail where more than N tests are skipped")
    group.addoption("--shard", metavar="K/N", help="run the K-th of N parts of the chosen tests, K from 0")
    group.addoption("--skip-log", type=Path, metavar="FILE", help="append the reason of every skipped test to FILE, one a line")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep the tests of one shard. It runs after the choice by markers."""
    if shard := config.getoption("shard"):
        number, count = (int(part) for part in shard.split("/"))
        kept = [item for item in items if crc32(item.nodeid.encode()) % count == number]
        config.hook.pytest_deselected(items=[item for item in items if item not in kept])
        items[:] = kept


def pytest_itemcollected(item: pytest.Item) -> None:
    """Tests with the fixture `data` read real recordings."""
    if isinstance(item, pytest.Function) and "data" in item.fixturenames:
        item.add_marker(pytest.mark.data)


NEEDS = {"command", "render", "soak"}
"""Markers of tests that may start processes: a renderer tries OpenGL in one of its own."""
_running: list[pytest.Item] = []


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    _running[:] = [item]
    yield
    _running.clear()


def _check_process(event: str, _: tuple[object, ...]) -> None:
    """A unit test that starts a process fails: the marker `command` would have it where it belongs."""
    if event == "subprocess.Popen" and _running and not NEEDS & {mark.name for mark in _running[0].iter_markers()}:
        raise RuntimeError(f"{_running[0].nodeid} starts a process and has no marker `command`")


sys.addaudithook(_check_process)


def skip_reasons(config: pytest.Config) -> list[str]:
    """The reason of every skipped test, in alphabetical order. A worker of pytest-xdist has none: its tests count in the process that started it."""
    if hasattr(config, "workerinput"):
        return []
    terminal = config.pluginmanager.get_plugin("terminalreporter")
    reports = terminal.stats.get("skipped", []) if terminal else []
    # `longrepr` is (file, line, "Skipped: reason"); one line is kept of it.
    return sorted(" ".join(str(report.longrepr[2]).removeprefix("Skipped: ").split()) for report in reports)


def too_many(config: pytest.Config) -> bool:
    most = config.getoption("most_skips")
    return most is not None and len(skip_reasons(config)) > most


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile the tracker's kernels before several workers begin, each of which would compile all of them where they are not in the cache."""
    if getattr(session.config.option, "numprocesses", None) and not hasattr(session.config, "workerinput"):
        from tracker.geometry.compile_ahead import compiling

        with compiling(2) as processes:
            for process in processes:
                process.wait()


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    reasons, log = skip_reasons(session.config), session.config.getoption("skip_log")
    if log and reasons:
        with log.open("a", encoding="utf-8") as file:
            file.writelines(f"{reason}\n" for reason in reasons)
    # A run that failed or was stopped keeps its own exit status.
    if too_many(session.config) and session.exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    reasons, most = skip_reasons(config), config.getoption("most_skips")
    terminalreporter.write_line(f"skips: {len(reasons)}")
    for reason, count in Counter(reasons).most_common():
        terminalreporter.write_line(f"  {count} x {reason}")
    if too_many(config):
        terminalreporter.write_line(f"error: {len(reasons)} tests are skipped, at most {most} may be (--most-skips)", red=True)
