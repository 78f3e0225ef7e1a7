"""The command `pilsim place`: compare or train policies that place robots."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import OmitArgPrefixes, arg

from sim.cli.options import DetectorModelName, json_text, locked, unset
from sim.cli.scenario_options import USUAL, SceneOptions, given
from tracker.options import Ending, Least

if TYPE_CHECKING:
    from sim.policies.rollouts import EpisodeResult


@dataclass(frozen=True)
class EpisodeOptions:
    """The environment of an episode."""

    drive: str = "kinematic"
    """Motion of the robots: kinematic, or physics (wheels on MuJoCo's terrain)."""
    observation: str = "state"
    """What a policy observes: state gives visible people their true ids; tracks runs SLAM and tracker, and scores it, too."""
    detector_model: DetectorModelName = "independent"
    """The detector of people: a file of `pilsim fit-detector`, fairmot, faster-rcnn, keypoint-rcnn, pets-det or pixels."""
    parameters: Annotated[Path | None, unset("FILE.toml", "none")] = None
    """Parameters of the tracker of --observation tracks, as `pilsim tune` writes them."""
    density: Annotated[str | None, unset("PRESET", "none")] = None
    """A preset, pilsun, s2l1, s2l2 or s2l3: its world, robots and people replace --world, --robots and --people."""


@dataclass(frozen=True)
class Training:
    """Training of a policy by PPO."""

    train: Annotated[int | None, Least(1), unset("INT", "no training")] = None
    """Train PPO for this number of decisions, in place of a comparison; needs the extra `rl`."""
    out: Path = Path("runs/ppo")
    """Folder of ppo.zip, curve.csv and curve.png."""


@dataclass(frozen=True)
class Place:
    """Compare, or train, policies that place robots so as to see people.

    All policies play the same episodes: the same maps, people and starts. The table
    gives means over seeds with 95 % intervals. Its columns are the expected information
    about a person, the shares of people that one and two robots see, the way driven,
    collisions, and frightened people per decision. With --observation tracks, the
    default tracker is scored, too: HOTA, IDF1, MOTA and the error of the robots' paths.
    A second table gives paired differences from the first policy. A difference is
    significant where its interval excludes 0.

    The policies are:
      - random      goes to random places, one after another
      - static      stays on the best ring
      - lloyd       covers the places where people walk
      - greedy      takes the most informative next move
      - predictive  takes the most informative way over the next 7.5 s
      - ppo:FILE    is a policy that --train wrote

    Examples: pilsim place --policy random lloyd greedy --episodes 20 --workers 2
              pilsim place --policy greedy --world campus --people 35 --json
              pilsim place --policy static greedy --observation tracks --episodes 5 --picture mota.png
              pilsim place --train 300000 --out runs/ppo && pilsim place --policy ppo:runs/ppo/ppo.zip
    """

    policy: tuple[str, ...] = ("random", "static", "lloyd", "greedy")
    """Policies to compare, one or more of random, static, lloyd, greedy, predictive, ppo:FILE."""
    episodes: Annotated[int, Least(1)] = 20
    """Episodes of each policy, with seeds from --seed on; ten seeds in a row share a map."""
    seed: Annotated[int, Least(0)] = 0
    """The first seed."""
    steps: Annotated[int, Least(1)] = 240
    """Decisions of an episode, two a second."""
    workers: Annotated[int, Least(1)] = 1
    """Number of processes; the figures are the same with any number."""
    picture: Annotated[Path | None, Ending(".png"), unset("FILE.png", "none is drawn")] = None
    """A picture of the means with their intervals."""
    json: bool = False
    """Print JSON alone: means, intervals and every episode."""
    scene: Annotated[OmitArgPrefixes[SceneOptions], arg(name="scene")] = dataclasses.replace(USUAL, world="ruins")
    """These options set the world, and who is in it."""
    episode: Annotated[OmitArgPrefixes[EpisodeOptions], arg(name="episode")] = EpisodeOptions()
    """These options change what happens in an episode."""
    training: Annotated[OmitArgPrefixes[Training], arg(name="training")] = Training()
    """These options train a policy with PPO."""

    def run(self) -> None:
        import sim  # noqa: F401
        from sim.policies.rollouts import policy_of

        if self.training.train is not None:
            from sim.policies.training import train

            print(train(self._options(), self.training.train, self.training.out, self.seed))
            return
        if not self.policy:
            raise ValueError("policy is empty, needs one or more of random, static, lloyd, greedy, predictive, ppo:FILE")
        for name in self.policy:
            policy_of(name)
        with locked(self.picture):
            self._compare()

    def _compare(self) -> None:
        """Play the episodes, print the tables, and draw the picture."""
        from sim.policies.rollouts import differences, draw, table, text

        outcomes = self._outcomes()
        found, less = table(outcomes), differences(outcomes)
        if self.json:
            print(json_text({"means": _plain(found), "differences": _plain(less), "episodes": [_row(o) for o in outcomes]}, indent=1))
        else:
            what = f"{self.episode.density or self.scene.world}, {self.steps} decisions each"
            seeds = f"{self.episodes} seed{'s' * (self.episodes != 1)} from {self.seed}"
            print(text(found, less), f"means over {seeds} with 95 % intervals; {what}", sep="\n\n")
        if self.picture is not None:
            draw(found, f"{self.episode.density or self.scene.world}, {self.episodes} episode{'s' * (self.episodes != 1)}", self.picture)

    def _outcomes(self) -> list[EpisodeResult]:
        """The outcomes of all episodes, ordered by policy and seed."""
        from sim.policies.rollouts import compare
        from tracker.io.progress import progress_bar

        seeds = range(self.seed, self.seed + self.episodes)
        out: list[EpisodeResult] = []
        with progress_bar(total=len(set(self.policy)) * len(seeds), unit=" episodes", leave=False) as bar:
            for batch in compare(self.policy, seeds, self._options(), self.steps, self.workers):
                out += batch
                bar.update(len(batch))
        return out

    def _options(self) -> dict[str, Any]:
        from sim.placement.config import DENSITIES
        from tracker.detector_models.model import INDEPENDENT, chosen_model
        from tracker.parameter_file import read_parameters

        options = given(self.scene) | given(self.episode)
        if (model := options.pop("detector_model")) != INDEPENDENT:
            options["detector_model"] = chosen_model(model)
        if (file := options.pop("parameters", None)) is not None:
            options["parameters"] = tuple(read_parameters(file).items())
        # A preset replaces the world and who is in it.
        replaced = () if self.episode.density is None else DENSITIES["pilsun"]
        return {name: value for name, value in options.items() if name not in replaced}


def _plain(rows: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    return {name: {measure: dataclasses.asdict(value) for measure, value in row.items()} for name, row in rows.items()}


def _row(outcome: EpisodeResult) -> dict[str, Any]:
    """An episode without the time that it took: the same seed prints the same JSON."""
    return {name: value for name, value in dataclasses.asdict(outcome).items() if name != "act_ms"}
