"""The whole way once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sim.commands.options import Out


@dataclass(frozen=True)
class Demo:
    """Simulate people and robots, track them, score and draw the result.

    The command runs the whole pipeline once, at 6 frames a second.

    Examples: pilsim demo
              pilsim demo --frames 333 --seed 7 --out runs/seven
    """

    frames: int = 60
    """Number of frames, at 6 a second; the paper's set has 333."""
    seed: int = 0
    """Seed of all random numbers; the same seed gives the same bytes."""
    robots: int = 4
    """Number of rovers, each with a panoramic camera."""
    people: int = 10
    """Number of people."""
    world: str = "pilsun"
    """Name of the world, as `pilsim worlds` lists it. pilsun is an indoor laboratory with ramps, a step, a platform and furniture."""
    difficulty: float = 0.5
    """Difficulty of the terrain, from 0 (gentle) to 1."""
    width: int = 1024
    """Width of a panorama, pixels; it is half as high."""
    out: Out = Path("runs/demo")
    """Folder of all results. The same scenario again reuses what is there."""

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
