"""Trackers that a user might write: one that works, and some with faults."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from tracker.pipeline import track
from tracker.types import Estimate, Setup, Tick


def good(setup: Setup, ticks: Iterable[Tick]) -> Iterator[Estimate]:
    """The default tracker."""
    yield from track(setup, ticks)


def raising(setup: Setup, ticks: Iterable[Tick]) -> Iterator[Estimate]:
    for estimate in track(setup, ticks):
        if estimate.index == 1:
            raise ZeroDivisionError("nobody\nis there")
        yield estimate


def short(setup: Setup, ticks: Iterable[Tick]) -> list[Estimate]:
    return list(track(setup, ticks))[:-1]


def long(setup: Setup, ticks: Iterable[Tick]) -> list[Estimate]:
    out = list(track(setup, ticks))
    return [*out, out[-1]]


def twice(setup: Setup, ticks: Iterable[Tick]) -> Iterator[Estimate]:
    for estimate in track(setup, ticks):
        yield replace(estimate, target_id=np.array([7, 7]), position=np.zeros((2, 3)), covariance=np.zeros((2, 3, 3)))


def robotless(setup: Setup, ticks: Iterable[Tick]) -> Iterator[Estimate]:
    for estimate in track(setup, ticks):
        yield replace(estimate, T_world_robot={})


def numbers(setup: Setup, ticks: Iterable[Tick]) -> list[int]:
    return [tick.index for tick in ticks]


def hanging(setup: Setup, ticks: Iterable[Tick]) -> Iterator[Estimate]:
    while True:
        time.sleep(60.0)
    yield
