"""Sequences in places of a user: the truth is as exact as in our own worlds, and the bytes do not depend on the number of workers."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from sim.recording.record import record
from sim.scenario import Scenario
from sim.simulation import Simulation
from tests.sim.footfalls import Footfalls
from tests.worlds.places.samples import MODEL, write_house, write_png
from tracker.sequence.reader import read_sequence

PLACES = ("dem.png", "house.glb", "site.xml")


def named(folder: Path, place: str) -> str:
    """The name of the world of a file, which is written into a folder."""
    if place.endswith(".png"):
        return write_png(folder / place)
    if place.endswith(".glb"):
        return write_house(folder / place)
    (folder / place).write_text(MODEL)
    return str(folder / place)


def digests(folder: Path) -> dict[str, str]:
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.render
@pytest.mark.command
@pytest.mark.parametrize("place", PLACES)
def test_one_worker_and_two_write_the_same_bytes(tmp_path: Path, place: str) -> None:
    scenario = Scenario(world=named(tmp_path, place), robots=1, people=3, frames=2, width=128, seed=3)
    for workers in (1, 2):
        record(scenario, tmp_path / str(workers), workers=workers)
    assert digests(tmp_path / "1") == digests(tmp_path / "2")
    sequence = read_sequence(tmp_path / "1")
    assert "place.toml" in (tmp_path / "1" / "README.md").read_text()
    assert place in (tmp_path / "1" / "place.toml").read_text()
    assert ("View_001" in sequence.setup.mounts) == (place == "site.xml")


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("place", PLACES)
def test_feet_are_on_the_ground_and_nobody_is_in_a_wall(tmp_path: Path, place: str, seed: int) -> None:
    """The lowest point of each standing sole is on the ground to 2 cm, soles do not slide, and the middles of bodies are free."""
    simulation = Simulation(Scenario(world=named(tmp_path, place), robots=1, people=6, frames=30, seed=seed))
    places = []
    for _ in range(3):
        footfalls = Footfalls(simulation, 10)
        assert footfalls.gap.max() < 0.02
        assert footfalls.slide.max() < 0.03
        places.append(simulation.feet())
    assert not any(simulation.tipped().values())
    assert (simulation.world.feet.clearance_at(np.concatenate(places)[:, :2]) > -0.1).all()
