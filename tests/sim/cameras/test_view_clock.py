"""Clocks of fixed cameras: their grammar, and pictures of people at the times at which they are taken."""

from __future__ import annotations

import numpy as np
import pytest

from sim.cameras.view_clock import ViewClock, parse_view_clocks
from sim.recording.frames import Frame, raycast_frames
from sim.recording.tracker_setup import make_setup
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tests.sim.yard import yard
from tracker.geometry.cameras import pinhole
from tracker.recordings import RecordingCamera

EXACT = {"misses": 0.0, "clutter": 0.0, "bearing_noise": 0.0, "min_visible": 0.0}


def frames(view_clock: str) -> list[Frame]:
    """12 frames, 10 a second, of people who walk before two cameras that see nearly the same."""
    scenario = Scenario(seed=5, robots=0, people=6, frames=12, rate=10.0, view_clock=view_clock, **EXACT)  # type: ignore[arg-type]
    simulation = Simulation(scenario, yard())
    middle = simulation.feet().mean(axis=0)
    lens = pinhole(640, 480, 1.5)
    places = {f"View_{k:03d}": np.add(middle, (-9.0, y, 4.0)) for k, y in ((1, 0.0), (2, 1.0))}
    fixed = {name: RecordingCamera.looking_at(lens, place, middle) for name, place in places.items()}
    return list(raycast_frames(simulation, make_setup(simulation, fixed)))


def middles(bearings: np.ndarray) -> np.ndarray:
    """Directions of boxes in a fixed order."""
    return bearings[np.lexsort(bearings.T)]


def test_a_late_picture_shows_people_where_they_are_then() -> None:
    in_step, late = frames(""), frames("View_001:offset=0.2;View_002:offset=0.05")
    moved = []
    for before, frame, later in zip(in_step, late, late[1:], strict=False):
        assert not frame.tick.views
        if "View_001" in frame.pictures:
            # Two periods late, it is taken at a frame.
            taken, own = frame.pictures["View_001"], before.tick.views[0].detections
            assert taken.picture.time == pytest.approx(before.tick.time)
            np.testing.assert_allclose(middles(taken.detections.bearing), middles(own.bearing), atol=1e-9)
        # Half a period late, it shows people between two frames.
        half, first = later.pictures["View_002"], before.tick.views[1].detections
        assert half.picture.time == pytest.approx(before.tick.time + 0.05)
        if len(half.detections) == len(first):
            moved.append(np.abs(middles(half.detections.bearing) - middles(first.bearing)).max())
    assert len(moved) > 5
    assert 1e-4 < np.median(moved) < 0.05
    # What people could be seen of at a frame does not depend on when pictures are taken.
    for a, b in zip(in_step, late, strict=True):
        np.testing.assert_array_equal(a.truth.visible, b.truth.visible)


def test_pictures_that_are_lost_change_no_others() -> None:
    whole, lossy = frames("View_002:rate=5"), frames("View_002:rate=5,lost=0.3,freeze=0.3+0.3")
    taken = [[one.pictures["View_002"] for one in run if one.pictures] for run in (whole, lossy)]
    seen = [{one.picture.number: one.detections.bearing for one in run} for run in taken]
    assert len(seen[0]) == 6
    assert set(seen[1]) < set(seen[0]) - {2}
    for number, bearing in seen[1].items():
        np.testing.assert_array_equal(bearing, seen[0][number])


def test_the_grammar_of_clocks() -> None:
    found = parse_view_clocks("rate=7,offset=0.13;View_002:lost=0.1,freeze=4+3,freeze=9+1", 25.0)
    assert found == {"": ViewClock(7.0, 0.13), "View_002": ViewClock(lost=0.1, freezes=((4.0, 3.0), (9.0, 1.0)))}
    # The first frame, a loss, and a freeze that begins with a picture.
    pictures = ViewClock(2.0, 0.5, freezes=((1.0, 1.0),)).pictures(2.5, 10.0, np.random.default_rng(0))
    assert [(p.number, p.time, p.arrives) for p in pictures] == [(0, 0.5, True), (1, 1.0, False), (2, 1.5, False), (3, 2.0, True), (4, 2.5, True)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rate=40", "rate 40, needs at most 25 frames/s"),
        ("offset=-1", "offset '-1', needs a number"),
        ("freeze=3", "freeze '3', needs BEGIN"),
        ("lost=2", "lost '2', needs a number"),
        ("speed=1", "'speed=1', needs"),
        ("rate=5;rate=6", "names all cameras twice"),
    ],
)
def test_wrong_clocks_are_one_line(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=r"view_clock .*") as error:
        Scenario(rate=25.0, view_clock=text)
    assert words in str(error.value)
