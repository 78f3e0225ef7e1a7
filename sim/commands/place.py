"""Where should robots stand? Policies side by side."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from sim.commands.options import unset

if TYPE_CHECKING:
    from sim.placement_trial import Outcome


@dataclass(frozen=True)
class Place:
    """Try policies that place robots so that people stay seen, over many seeds; or train one.

    Each policy plays the same episodes: the same maps, people and starts. What is told is the mean over seeds with its 95 % interval, as shares of
    people seen by one and by two robots, GOSPA over that of saying nothing, collisions and people frightened in a decision; below that, by how much
    each policy differs from the first, seed by seed: a difference whose interval leaves out 0 is one.

    random: to a place at random, then to another. static: the best ring. lloyd: coverage of where people walk. greedy: where most is learnt of
    people, one move ahead. ppo:FILE: what `--train` left.

    Examples: pilsim place --policy random lloyd greedy --episodes 20 --workers 2
              pilsim place --policy greedy --world campus --people 35 --json
              pilsim place --policy static greedy --observation tracks --episodes 5 --picture mota.png
              pilsim place --train 300000 --out runs/ppo && pilsim place --policy ppo:runs/ppo/ppo.zip
    """

    policy: tuple[str, ...] = ("random", "static", "lloyd", "greedy")
    """Policies to try, one or more of random, static, lloyd, greedy, ppo:FILE."""
    episodes: int = 20
    """Episodes of each, with seeds from --seed on; ten seeds in a row share a map."""
    seed: int = 0
    """The first seed."""
    world: str = "ruins"
    """A name that `pilsim worlds` lists."""
    robots: int = 4
    """Rovers with a panoramic camera each."""
    people: int = 10
    """Who walk about."""
    difficulty: float = 0.5
    """Of the ground, from 0 (gentle) to 1."""
    drive: str = "kinematic"
    """kinematic, or physics: wheels on MuJoCo's terrain."""
    observation: str = "state"
    """state: people who are seen are told apart; tracks: SLAM and tracker in the loop, and MOTA is told, too."""
    density: Annotated[str | None, unset("STR", "none")] = None
    """pilsun, s2l1, s2l2 or s2l3: world, robots and people of that dataset, in place of the three options."""
    steps: int = 240
    """Decisions of an episode, two a second."""
    train: Annotated[int | None, unset("INT", "no training")] = None
    """Train PPO for so many decisions instead; needs the extra `rl`."""
    out: Path = Path("runs/ppo")
    """Where --train leaves ppo.zip, curve.csv and curve.png."""
    workers: int = 1
    """Processes that try policies; the figures are the same with any number."""
    picture: Annotated[Path | None, unset("FILE.png", "none is drawn")] = None
    """Draw the means with their intervals."""
    json: bool = False
    """Print JSON alone: means, intervals and every episode."""

    def run(self) -> None:
        import sim  # noqa: F401
        from sim.placement_contest import differences, draw, text
        from sim.placement_trial import policy_of, table

        for name, value in (("episodes", self.episodes), ("steps", self.steps), ("train", self.train), ("workers", self.workers)):
            if value is not None and value < 1:
                raise ValueError(f"{name} is {value}, needs at least 1")
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}, needs at least 0")
        if self.picture is not None and self.picture.suffix.lower() != ".png":
            raise ValueError(f"--picture is {self.picture}, needs a name that ends in .png")
        if self.train is not None:
            from sim.policies_training import train

            print(train(self._options(), self.train, self.out, self.seed))
            return
        if not self.policy:
            raise ValueError("policy is empty, needs one or more of random, static, lloyd, greedy, ppo:FILE")
        for name in self.policy:
            policy_of(name)
        outcomes = self._outcomes()
        found, less = table(outcomes), differences(outcomes)
        if self.json:
            print(json.dumps({"means": _plain(found), "differences": _plain(less), "episodes": [dataclasses.asdict(o) for o in outcomes]}, indent=1))
        else:
            what = f"{self.density or self.world}, {self.steps} decisions each"
            print(text(found, less), f"means over {self.episodes} seeds from {self.seed} with 95 % intervals; {what}", sep="\n\n")
        if self.picture is not None:
            draw(found, f"{self.density or self.world}, {self.episodes} episodes", self.picture)

    def _outcomes(self) -> list[Outcome]:
        """In the order of policies and seeds."""
        from tqdm import tqdm

        from sim.placement_contest import contest

        seeds = range(self.seed, self.seed + self.episodes)
        out: list[Outcome] = []
        with tqdm(total=len(set(self.policy)) * len(seeds), unit=" episodes", leave=False, disable=None) as bar:
            for some in contest(self.policy, seeds, self._options(), self.steps, self.workers):
                out += some
                bar.update(len(some))
        return out

    def _options(self) -> dict[str, Any]:
        options: dict[str, Any] = {"difficulty": self.difficulty, "drive": self.drive, "observation": self.observation}
        if self.density is not None:
            return options | {"density": self.density}
        return options | {"world": self.world, "robots": self.robots, "people": self.people}


def _plain(rows: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    return {name: {measure: dataclasses.asdict(value) for measure, value in row.items()} for name, row in rows.items()}
