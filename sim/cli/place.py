"""The command `pilsim place`: compare or train policies that place robots."""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import OmitArgPrefixes, arg

from sim.cli.options import USUAL, DetectorModelName, SceneOptions, command_line, given, json_text, locked, unset
from tracker.options import Ending, Least

if TYPE_CHECKING:
    from sim.policies.rollouts import EpisodeResult


@dataclass(frozen=True)
class EpisodeOptions:
    """The environment of an episode."""

    drive: str = "kinematic"
    """Motion of the robots: kinematic, or physics (wheels on MuJoCo's terrain)."""
    observation: str = "state"
    """Observation of a policy: state has the true ids of visible people; tracks runs SLAM and the tracker, and scores them, too."""
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
    """Folder of policy.onnx, ppo.zip, curve.csv and curve.png."""
    train_over: Annotated[tuple[str, ...], unset("NAME=VALUE,... [NAME=...]", "nothing differs")] = ()
    """Options of the environment that differ between the teams, with their values: world=hall,hills people=10,20 detector_model=fairmot,pixels."""


@dataclass(frozen=True)
class Place:
    """Compare, or train, policies that place robots so as to see people.

    All policies play the same episodes: the same maps, people and starts. The table
    gives means over seeds with 95 % intervals. Its columns are the expected information
    about a person, and the shares of people that one and two robots see. Then come the
    distance driven, and collisions and near misses with people per decision. With
    --observation tracks, the default tracker is scored, too: HOTA, IDF1, MOTA and the
    error of the robots' paths.
    A second table gives paired differences from the first policy. A difference is
    significant where its interval excludes 0.

    The policies are:
      - random      goes to random places, one after another
      - static      stays on the best ring
      - lloyd       covers the places where people walk
      - greedy      takes the most informative next move
      - predictive  takes the most informative way over the next 7.5 s
      - learned     follows a network, trained by PPO, but not in campus and ruins
      - ppo:FILE    is a policy that --train wrote

    Examples: pilsim place --policy random lloyd greedy --episodes 20 --workers 2
              pilsim place --policy greedy --world campus --people 35 --json
              pilsim place --policy greedy predictive --worlds campus ruins --observation tracks --page runs/placement
              pilsim place --train 300000 --out runs/ppo && pilsim place --policy ppo:runs/ppo/policy.onnx
    """

    policy: tuple[str, ...] = ("random", "static", "lloyd", "greedy")
    """Policies to compare, one or more of random, static, lloyd, greedy, predictive, learned, ppo:FILE."""
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
    page: Annotated[Path | None, unset("DIR", "none is written")] = None
    """A folder for index.html: tables, and videos of the best and the worst episode of each policy."""
    worlds: Annotated[tuple[str, ...], unset("NAME [NAME ...]", "that of --world")] = ()
    """Worlds of the comparison, with a table each. The policy learned was never trained in campus and ruins."""
    json: bool = False
    """Print JSON alone: means, intervals and every episode."""
    scene: Annotated[OmitArgPrefixes[SceneOptions], arg(name="scene")] = dataclasses.replace(USUAL, world="ruins")
    """These options set the world, its people and its robots."""
    episode: Annotated[OmitArgPrefixes[EpisodeOptions], arg(name="episode")] = EpisodeOptions()
    """These options change what happens in an episode."""
    training: Annotated[OmitArgPrefixes[Training], arg(name="training")] = Training()
    """These options train a policy with PPO."""

    def run(self) -> None:
        import sim  # noqa: F401
        from sim.policies.rollouts import policy_of

        if self.training.train is not None:
            from sim.policies.training import train

            print(train(self._options(), self.training.train, self.training.out, self.seed, _varied(self.training.train_over)))
            return
        if self.scene.robot is not None:
            raise ValueError("--robot is for generate, demo, stress and predict: the robots of a placement are rovers")
        if not self.policy:
            raise ValueError("policy is empty, needs one or more of random, static, lloyd, greedy, predictive, learned, ppo:FILE")
        for name in self.policy:
            policy_of(name)
        with locked(self.picture, self.page and self.page / "index.html"):
            self._compare()

    def _compare(self) -> None:
        """Play the episodes, print the tables, draw the picture, and write the page."""
        from sim.policies.rollouts import draw

        worlds = self.worlds or (self.episode.density or str(self.scene.world),)
        outcomes = {world: self._outcomes(world) for world in worlds}
        if self.json:
            found = {world: _values(of) for world, of in outcomes.items()}
            print(json_text({"worlds": found} if self.worlds else next(iter(found.values())), indent=1))
        else:
            for world, of in outcomes.items():
                self._print(world, of)
        if self.picture is not None:
            from sim.policies.rollouts import table

            every = [one for of in outcomes.values() for one in of]
            each = " each" * (len(outcomes) > 1)
            draw(table(every), f"{', '.join(outcomes)}, {self.episodes} episode{'s' * (self.episodes != 1)}{each}", self.picture)
        if self.page is not None:
            from sim.report.placement_page import PlacementRun, write_placement_page

            options = {name: value for name, value in self._options().items() if name != "world"}
            self.page.mkdir(parents=True, exist_ok=True)
            print(write_placement_page(PlacementRun(outcomes, options, self.steps, command_line(self, without=())), self.page), file=sys.stderr)

    def _print(self, world: str, outcomes: list[EpisodeResult]) -> None:
        """Print the tables of one world."""
        from sim.policies.rollouts import differences, table, text

        seeds = f"{self.episodes} seed{'s' * (self.episodes != 1)} from {self.seed}"
        print(text(table(outcomes), differences(outcomes)), sep="\n\n")
        print(f"\nmeans over {seeds} with 95 % intervals; {world}, {self.steps} decisions each")

    def _outcomes(self, world: str) -> list[EpisodeResult]:
        """The outcomes of all episodes in a world, ordered by policy and seed."""
        from sim.policies.rollouts import compare
        from tracker.io.progress import progress_bar

        seeds = range(self.seed, self.seed + self.episodes)
        options = self._options() | ({"world": world} if self.worlds else {})
        out: list[EpisodeResult] = []
        with progress_bar(total=len(set(self.policy)) * len(seeds), unit=" episodes", desc=world, leave=False) as bar:
            for batch in compare(self.policy, seeds, options, self.steps, self.workers):
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
        # A preset replaces the world, the robots and the people.
        replaced = () if self.episode.density is None else DENSITIES["pilsun"]
        return {name: value for name, value in options.items() if name not in replaced}


def _values(outcomes: list[EpisodeResult]) -> dict[str, Any]:
    """Means, differences and episodes as JSON values."""
    from sim.policies.rollouts import differences, table

    return {"means": _plain(table(outcomes)), "differences": _plain(differences(outcomes)), "episodes": [_row(o) for o in outcomes]}


def _plain(rows: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    return {name: {measure: dataclasses.asdict(value) for measure, value in row.items()} for name, row in rows.items()}


def _row(outcome: EpisodeResult) -> dict[str, Any]:
    """An episode without the time that it took: the same seed prints the same JSON."""
    return {name: value for name, value in dataclasses.asdict(outcome).items() if name != "act_ms"}


def _varied(texts: tuple[str, ...]) -> dict[str, list[Any]]:
    """The options of the environment that differ between teams, with their values, from texts NAME=VALUE,VALUE."""
    from sim.placement.config import PlacementConfig
    from tracker.detector_models.model import chosen_model

    out: dict[str, list[Any]] = {}
    kinds = {field.name: type(field.default) for field in dataclasses.fields(PlacementConfig) if field.name != "action"}
    for text in texts:
        name, _, values = text.partition("=")
        kind = kinds.get(name)
        if kind not in (str, int, float) or name in out:
            raise ValueError(f"--train-over is {text}, needs NAME=VALUE,... of another option of the environment, as people=10,20")
        try:
            out[name] = [kind(value) for value in values.split(",")]
        except ValueError:
            raise ValueError(f"--train-over is {text}, needs {kind.__name__} values of {name}") from None
    if "detector_model" in out:
        out["detector_model"] = [chosen_model(value) for value in out["detector_model"]]
    return out
