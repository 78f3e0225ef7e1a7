"""The whole way once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sim.commands.options import Out


@dataclass(frozen=True)
class Demo:
    """Simulate a crowd and robots, track it, score it, and draw it: the whole way once.

    Example: pilsim demo --frames 333 --seed 7 --out runs/seven
    """

    frames: int = 60
    """How many frames, at 6 a second; the paper's set has 333."""
    seed: int = 0
    """Of everything random. The same seed gives the same bytes."""
    robots: int = 4
    """Rovers with a panoramic camera each."""
    people: int = 10
    """Who walk about."""
    world: str = "pilsun"
    """The place: pilsun is a small indoor lab with ramps, a step, a platform and furniture."""
    difficulty: float = 0.5
    """Of the ground, from 0 (gentle) to 1."""
    width: int = 1024
    """Of a panorama in pixels; it is half as high."""
    out: Out = Path("runs/demo")
    """Where everything goes. The same scenario again reuses what is there."""

    def run(self) -> None:
        from sim.demo import run_demo
        from sim.scenario import Scenario

        scenario = Scenario(
            world=self.world,
            difficulty=self.difficulty,
            seed=self.seed,
            robots=self.robots,
            people=self.people,
            frames=self.frames,
            width=self.width,
        )
        run_demo(scenario, self.out)
