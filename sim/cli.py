"""Irregular worlds, people and panoramic robots: simulate, track, score. Bad input is one line, `error: …`, and exit code 2."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from tyro.conf import Positional, arg

from sim.gl import GLUnavailable

if TYPE_CHECKING:
    from tracker.pipeline import Parameters

Out = Annotated[Path, arg(metavar="DIR")]


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


@dataclass(frozen=True)
class Track:
    """Track people in a sequence made by pilsim, or in a PETS 2009 folder; or place the robots of a UTIAS set (MRCLAM).

    A PETS folder has annotations/*-cropped.xml, detections/View_00N.txt (MOT15), and calibration/ in it or beside it.
    Examples: pilsim track PETS2009/S2.L1 --views 1,5,7 --out runs/pets
              pilsim track MRCLAM_Dataset1 --map unknown --out runs/utias
    """

    source: Positional[Path]
    """The folder to track."""
    out: Out
    """Where tracks.txt (MOT15, metres) and robots.csv go."""
    views: str = ""
    """Numbers of the PETS cameras to use, as in 1,5,7; all where it is empty."""
    detections: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """VIEW=FILE: other detections (MOT15) for a PETS camera; may be given several times."""
    degrade: str = ""
    """drop=P,clutter=N,noise=PX: PETS detections made worse: a share lost, false boxes a view and frame, pixels that boxes are moved by."""
    seed: int = 0
    """Of what --degrade draws."""
    delay: int = 0
    """Frames that a frame is told late; people are smoothed by what came since."""
    hypotheses: Literal["single", "multiple"] = "single"
    """Whether one best hypothesis on people is kept, or track trees with the best set of tracks as a maximum-weight clique."""
    k_h: int | None = None
    """K_H: hypotheses kept; those of each are children of one graph (multiple)."""
    i_bls_max: int | None = None
    """Moves of the clique search at most (multiple)."""
    delta_a: float | None = None
    """Longest gap that is bridged, s."""
    n_conf: int | None = None
    """Frames until a track may be believed."""
    map: Literal["known", "unknown"] = "unknown"
    """UTIAS: whether the filter is told where the landmarks are."""
    slam: Literal["ekf", "iekf", "fej", "invariant"] | None = None
    """The filter of the robots' places: extended, iterated, with first-estimates Jacobians (UTIAS only), or with the right-invariant error."""
    iterations: int | None = None
    """Linearisations of an update, 2 where nothing is given; ekf has one."""
    correction: Literal["on", "off"] = "on"
    """Whether each robot's correction factor is estimated."""

    def run(self) -> None:
        from sim.demo import tracked
        from tracker.formats.utias import is_utias
        from tracker.sources import Choice, open_source

        views = _numbers(self.views)
        if is_utias(self.source):
            if views:
                raise ValueError(f"{self.source}: --views chooses PETS cameras; a UTIAS set has none")
            self._explore()
            return
        if self.map != "unknown" or self.slam == "fej":
            raise ValueError(f"{self.source}: --map and --slam fej are for UTIAS sets (Barcodes.dat), and this is none")
        choice = Choice.parse(self.detections, self.degrade, self.seed)
        sequence = open_source(self.source, views, choice)
        results = tracked(sequence, self.out, {"source": self.source.name, "views": views} | choice.to_run(), self._parameters())
        people = len({identity for ids, _ in results.tracks.values() for identity in ids.tolist()})
        print(f"{self.out}: {people} people in {results.frames} frames; `pilsim score {self.source} {self.out}` scores it")

    def _parameters(self) -> Parameters | None:
        """What was asked of the filter, for a sequence; None where nothing was."""
        from tracker.pipeline import Parameters
        from tracker.slam import SlamParameters

        people = self._people()
        if self.slam is None and self.iterations is None and self.correction == "on":
            return people
        chosen = SlamParameters(correction=self.correction == "on")
        if self.iterations is not None:
            chosen = replace(chosen, iterations=self.iterations)
        if self.slam == "ekf":
            chosen = replace(chosen, mode="iekf", iterations=1)
        elif self.slam is not None:
            chosen = replace(chosen, mode=self.slam)
        return replace(people or Parameters(), slam=chosen)

    def _people(self) -> Parameters | None:
        """What was asked of the tracker of people; None where nothing was."""
        from tracker.pipeline import Parameters
        from tracker.selection import MultipleParameters

        given = {name: getattr(self, name) for name in ("k_h", "i_bls_max", "delta_a", "n_conf")}
        given = {name: value for name, value in given.items() if value is not None}
        for name, value in given.items():
            if not value > 0:
                raise ValueError(f"--{name.replace('_', '-')} is {value}, needs more than 0")
        if self.hypotheses == "multiple":
            multiple = replace(MultipleParameters(), **given, small_graphs=self.k_h is not None)
            return Parameters(multiple=multiple, delay=self.delay)
        if {"k_h", "i_bls_max"} & set(given):
            raise ValueError("--k-h and --i-bls-max are for --hypotheses multiple")
        if not given and not self.delay:
            return None
        return replace(Parameters(), targets=replace(Parameters().targets, **given), delay=self.delay)

    def _explore(self) -> None:
        from tracker.course import PlanarParameters
        from tracker.expedition import explore

        asked = {"mode": self.slam, "iterations": self.iterations, "correction": self.correction == "on"}
        parameters = PlanarParameters(**{name: value for name, value in asked.items() if value is not None})  # type: ignore[arg-type]
        paths = explore(self.source, self.out, self.map == "known", parameters)
        counted = ", ".join(f"{count} {reason}" for reason, count in paths.run["counters"].items() if count)
        for mended in paths.run["mended"]:
            print(mended)
        print(f"{self.out}: {len(paths.poses)} robots at {len(paths.times)} times ({counted}); `pilsim score {self.source} {self.out}` scores it")


@dataclass(frozen=True)
class Score:
    """Score what `track` left against the truth, or any two MOT15 files against each other.

    Examples: pilsim score PETS2009/S2.L1 runs/pets --json
              pilsim score --truth gt.txt --result mine.txt --iou 0.5
    """

    source: Positional[Path | None] = None
    """The folder that was tracked."""
    results: Positional[Path | None] = None
    """The folder that `track` wrote."""
    truth: Path | None = None
    """A MOT15 file of truth, instead of folders."""
    result: Path | None = None
    """A MOT15 file of a tracker's output."""
    iou: float | None = None
    """Compare boxes with this least overlap; without it, places on the ground within 1 m."""
    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from tracker import expedition, paths
        from tracker.evaluation import evaluate, evaluate_files, table
        from tracker.formats.utias import is_utias
        from tracker.results import read_results
        from tracker.sources import Choice, open_source

        if self.source and is_utias(self.source) and self.results and not (self.truth or self.result or self.iou):
            scores = expedition.evaluate_paths(self.source, self.results)
            print(json.dumps(scores, indent=1) if self.json else paths.table(scores))
            return
        if self.source and self.results and not (self.truth or self.result) and self.iou is None:
            results = read_results(self.results)
            scores = evaluate(open_source(self.source, _views(results.run), Choice.of_run(results.run)), results)
        elif self.truth and self.result and not (self.source or self.results):
            scores = evaluate_files(self.truth, self.result, self.iou)
        else:
            raise ValueError("score takes either SOURCE and RESULTS, or --truth and --result with or without --iou")
        print(json.dumps(scores, indent=1) if self.json else table(scores))


@dataclass(frozen=True)
class Generate:
    """Generate a sequence: the twin of a PETS 2009 sequence, its people on their real paths before the real cameras and before rovers.

    Example: pilsim generate twin --annotations S2.L1/annotations/PETS2009-S2L1.xml --calibration calibration --views 1,5,7 --out runs/twin
    """

    preset: Positional[Literal["twin"]]
    """What kind of sequence."""
    annotations: Annotated[Path, arg(metavar="FILE")]
    """Who walked where: the CVML file of any PETS 2009 sequence, boxes in View_001."""
    calibration: Annotated[Path, arg(metavar="DIR")]
    """Folder of View_001.xml and so on (Tsai)."""
    out: Out
    """Where the sequence goes; must not be there yet."""
    views: str = "1"
    """Numbers of the PETS cameras that look on, as in 1,5,7."""
    frames: int | None = None
    """How many of the annotated frames, from the first on; all where it is not given."""
    robots: int = 2
    """Rovers with a panoramic camera each."""
    width: int = 1024
    """Of a panorama in pixels."""
    seed: int = 0
    """Of everything random."""

    def run(self) -> None:
        from functools import partial

        from tqdm import tqdm

        from sim.twin import Twin, generate, likeness

        views = tuple(_numbers(self.views))
        twin = Twin(self.annotations, self.calibration, views, self.frames, self.robots, self.width, self.seed)
        generate(twin, self.out, progress=partial(tqdm, desc="frames", unit="frame"))
        print(f"{self.out}: a sequence (README.md in it); `pilsim track {self.out}` tracks it")
        if 1 in views:
            alike = sorted(likeness(twin, self.out).tolist())
            print(f"overlap of {len(alike)} annotated boxes with the twin's in View_001: median IoU {alike[len(alike) // 2]:.3f}")


@dataclass(frozen=True)
class Doctor:
    """Say what this computer has: versions, the OpenGL that renders, whether it is a GPU, and measured panoramas per second."""

    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from sim.doctor import describe, examine

        report = examine()
        print(json.dumps(report, indent=1) if self.json else describe(report))


@dataclass(frozen=True)
class Worlds:
    """List the worlds with their measures, draw them, or give one away for other programs.

    Examples: pilsim worlds
              pilsim worlds --preview runs/worlds --difficulty 1
              pilsim worlds quarry --seed 3 --export quarry.glb
    """

    name: Positional[str | None] = None
    """One world; all where there is none."""
    difficulty: float = 0.5
    """Of relief, steps, clutter and occlusion, from 0 (gentle) to 1 (rovers begin to fail)."""
    seed: int = 0
    """Another seed is another place of the same kind."""
    preview: Annotated[Path | None, arg(metavar="DIR")] = None
    """Draw NAME.png into this folder: as a rover sees it, from above, and the plan."""
    export: Annotated[Path | None, arg(metavar="FILE")] = None
    """Write the scene of the named world; the ending says how: .glb, .obj, .ply, .xml (MJCF and its files), .mjz (MuJoCo's archive)."""
    slip: Annotated[float, arg(metavar="SECONDS")] = 0.0
    """Drive four rovers for so long and measure how far wheel odometry is off, a metre driven."""
    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from sim.gallery import Wanted, describe, survey

        rows = survey(self.name, self.difficulty, self.seed, Wanted(self.preview, self.export, self.slip))
        print(json.dumps(rows, indent=1) if self.json else describe(rows))


@dataclass(frozen=True)
class Clique:
    """Find the heaviest clique of a weighted graph in the DIMACS format, by breakout local search or exactly.

    Vertices count from 1, as in the file. Example: pilsim clique C500.9.clq --seconds 10 --seed 1 --target 6955 --json
    """

    file: Positional[Path]
    """Lines `p edge N M`, `n VERTEX WEIGHT` (1 where there is none), `e A B`."""
    seconds: float = 10.0
    """Search for so long, or prove for so long."""
    seed: int = 0
    """Of the search; the same seed makes the same moves."""
    target: float | None = None
    """Stop at a clique of at least this weight."""
    exact: bool = False
    """Prove the best one, for small graphs."""
    json: bool = False
    """Print JSON alone: weight, moves, seconds, clique."""

    def run(self) -> None:
        from tracker.clique import Limits, search
        from tracker.exact_clique import exact
        from tracker.formats.dimacs import read_graph

        graph = read_graph(self.file)
        search(graph, Limits(moves=1))  # compiles: not part of the seconds
        found = exact(graph, self.seconds) if self.exact else search(graph, Limits(seconds=self.seconds, target=self.target), self.seed)
        clique = [int(v) + 1 for v in found.vertices]
        if self.json:
            print(json.dumps({"weight": found.weight, "moves": found.moves, "seconds": round(found.seconds, 6), "clique": clique}))
        else:
            kind = "the heaviest clique" if self.exact else "a clique"
            print(f"{kind} of weight {found.weight:g}, {len(clique)} of {len(graph)} vertices, after {found.moves} moves in {found.seconds:.3f} s")
            print(*clique)


def _views(run: dict[str, Any]) -> list[int]:
    views = run.get("views", [])
    if not isinstance(views, list) or not all(isinstance(view, int) for view in views):
        raise ValueError(f"run.json: views is {views!r}, needs a list of numbers")
    return views


def _numbers(text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",") if part.strip()]
    except ValueError:
        raise ValueError(f"--views is {text!r}, needs numbers as in 1,5,7") from None


Command = (
    Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[Track, tyro.conf.subcommand("track")]
    | Annotated[Score, tyro.conf.subcommand("score")]
    | Annotated[Worlds, tyro.conf.subcommand("worlds")]
    | Annotated[Clique, tyro.conf.subcommand("clique")]
    | Annotated[Generate, tyro.conf.subcommand("generate")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
)


def main() -> None:
    """Entry point; leaves with 0, with 2 and one line where the input is at fault, with 130 when interrupted."""
    try:
        command = tyro.cli(Command, prog="pilsim", description=__doc__)
        command.run()
        sys.stdout.flush()
    except BrokenPipeError:
        # Who reads us has gone (`pilsim … | head`): nothing to say, and nothing to say it to.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except KeyboardInterrupt:
        print("interrupted: what was whole is kept, the same command goes on from there", file=sys.stderr)
        sys.exit(130)
    except (ValueError, OSError, GLUnavailable) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
