"""One hypothesis on real people: the first half of PETS 2009 S2.L1 with detections that are poor, halved, or false, told 10 frames late."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tracker.evaluation import evaluate
from tracker.pipeline import Parameters, track
from tracker.results import Results
from tracker.sequence import TicksInMemory
from tracker.sources import Choice, open_source

FRAMES = 400


@pytest.mark.slow
@pytest.mark.parametrize(
    ("views", "poor", "degrade", "mota", "idf1"),
    [
        ([1, 5, 7], False, "", 0.98, 0.96),
        ([1, 5, 7], True, "", 0.955, 0.96),
        ([1], True, "", 0.79, 0.74),
        ([1, 5, 7], False, "drop=0.5", 0.97, 0.94),
        ([1, 5, 7], False, "drop=0.3,clutter=2", 0.95, 0.93),
    ],
)
def test_people_keep_their_ids(data: Callable[..., Path], views: list[int], poor: bool, degrade: str, mota: float, idf1: float) -> None:
    folder = data("pets2009", "S2.L1")
    other = [f"{views[0]}={folder / 'mot15' / 'det.txt'}"] if poor else []
    sequence = open_source(folder, views, Choice.parse(other, degrade, 0))
    assert sequence.truth is not None
    ticks = TicksInMemory(tuple(itertools.islice(iter(sequence.ticks), FRAMES)), sequence.setup.mounts)
    half = replace(sequence, ticks=ticks, truth=sequence.truth[:FRAMES])
    found = evaluate(half, Results.of(track(half.setup, half.ticks, Parameters(delay=10)), {}))["targets"]
    assert found["mota"] >= mota
    assert found["idf1"] >= idf1
