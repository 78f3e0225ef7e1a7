"""The command `pilsim stress`: test a tracker on sweeps of one parameter each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, UseAppendAction, arg

from sim.cli.options import USUAL, BoxOptions, SceneOptions, changed_options, command_line, given, json_text, unset
from tracker.options import OPTIONS, POSITIVE, FilterOptions, Least, PeopleOptions, parameters_from

if TYPE_CHECKING:
    from sim.stress.runner import Trial
    from sim.stress.sweeps import Case
    from sim.stress.tracker_under_test import TrackerUnderTest


@dataclass(frozen=True)
class TrackerOptions(PeopleOptions, FilterOptions):
    """The tracker under test."""

    tracker: Annotated[str, unset("MODULE:FUNCTION", "pilsim's own")] = ""
    """A tracker of your own: a function of (setup, ticks) that yields one Estimate per tick, as tracker.pipeline.track does."""
    results: Annotated[Path | None, unset("DIR", "none")] = None
    """Tracks made elsewhere, in place of a tracker: DIR/ID/SEED.txt, as density/3/4.txt; MOT15 with x, y, z."""

    def chosen(self) -> TrackerUnderTest:
        """The tracker with its changed options. Raises ValueError for a missing tracker, and for options that it does not have."""
        from sim.stress.tracker_under_test import TrackerUnderTest, load_tracker
        from tracker.parameter_file import read_parameters

        if self.results is not None and not self.results.is_dir():
            raise ValueError(f"{self.results}: no such folder")
        if self.tracker:
            load_tracker(self.tracker)
        options = changed_options(self, OPTIONS)
        if self.parameters is not None:
            if not self.tracker:
                parameters_from({"parameters": self.parameters})
            # Results keep the values, and not the name of a file that may change.
            options["parameters"] = read_parameters(self.parameters)
        return TrackerUnderTest(self.tracker, options, "" if self.results is None else str(self.results.resolve()))


@dataclass(frozen=True)
class RoverOptions:
    """Rovers in every simulated run, unless the sweep sets them; sim/README.md has cameras and effects."""

    camera: Annotated[str, unset("MODEL[:OPTIONS]", "equirectangular")] = ""
    """Camera of the rovers, as for `pilsim generate`."""
    effect: Annotated[UseAppendAction[tuple[str, ...]], unset("NAME=VALUE", "none")] = ()
    """An error of the cameras, as readout=0.02 or mount_angle=0.5; may be repeated."""
    speed: float = 0.7
    """Top speed of the rovers, m/s."""


@dataclass(frozen=True)
class MachineOptions:
    """Machine and time limit of the runs."""

    cluster: Annotated[str | None, unset("ADDRESS", "this machine alone")] = None
    """Address of a Dask scheduler, as tcp://10.0.0.1:8786, in place of this machine; its workers must see DIR under the same path."""
    limit: Annotated[float, POSITIVE] = 1800.0
    """Time limit of a run, s."""


@dataclass(frozen=True)
class Stress:
    """Test a tracker on sweeps of one parameter each; find where it fails.

    A sweep is for instance more people, rougher terrain, lost views or slipping
    wheels. DIR/results.jsonl has a line per run: scores, bounds, causes of errors, and
    pictures of the worst moments. The same command continues an interrupted test.
    `--list` shows the sweeps; all of them start from the run robots/2. Two trackers
    that you want to compare need a folder each.

    Examples: pilsim stress --sweep density --seeds 5 --no-render --workers 2 --out runs/density
              pilsim stress --sweep placement --seeds 5 --no-render --out runs/placement
              pilsim stress --sweep density filter --ablation --workers 2 --out runs/two
              pilsim stress --sweep robots/2 --slam ekf --correction off --seeds 20 --no-render --out runs/ekf
              pilsim stress --pets data/pets2009/S2.L1 --out runs/pets
              pilsim stress --recording my-cameras --seeds 3 --out runs/mine
              pilsim stress --sweep misses --tracker mine:track --out runs/mine
    """

    out: Annotated[Path | None, unset("DIR", "needed, but for --list")] = None
    """Folder of the results."""
    sweep: Annotated[tuple[str, ...], arg(help_behavior_hint="(default: all)")] = ()
    """Names of sweeps, or of single cases as density/3."""
    show: Annotated[bool, arg(name="list")] = False
    """Show the sweeps and do nothing else."""
    json: bool = False
    """With --list: print each case as a line of JSON, with its scenario. Otherwise: print the rows when all runs are done."""
    seeds: Annotated[int, Least(1)] = 1
    """Number of seeds of each case."""
    first_seed: Annotated[int, Least(0)] = 0
    """The first seed."""
    frames: Annotated[int, Least(2)] = 60
    """Number of frames of a run; the sweep of the frame rate counts them at 6 frames per second."""
    width: int = 512
    """Width of a panorama, pixels."""
    render: bool = True
    """Render panoramas and detect features in them. --no-render makes boxes and landmarks by ray casting, many times faster."""
    ablation: bool = False
    """Run each case with stages replaced by the truth, in all 16 combinations, and attribute the loss to the stages."""
    pets: Annotated[Path | None, unset("DIR", "none")] = None
    """A PETS 2009 sequence (as for `pilsim track`) to run with its twin, or alone where no sweep is named."""
    recording: Annotated[Path | None, unset("DIR", "none")] = None
    """A recording with truth (as for `pilsim track`) to test in place of simulated runs: fewer boxes, false boxes, fewer cameras."""
    scene: Annotated[OmitArgPrefixes[SceneOptions], arg(name="scene")] = USUAL
    """These options set world, people and robots, unless the sweep sets them. Where the world is pilsun, density and placement are in ruins."""
    boxes: Annotated[OmitArgPrefixes[BoxOptions], arg(name="detector")] = BoxOptions()
    """These options choose where the boxes of people come from."""
    subject: Annotated[OmitArgPrefixes[TrackerOptions], arg(name="tracker")] = TrackerOptions()
    """These options choose the tracker under test, for every run; a sweep of a parameter overrides it."""
    rovers: Annotated[OmitArgPrefixes[RoverOptions], arg(name="expert rover")] = RoverOptions()
    """These options set the defaults of every simulated run."""
    workers: int = 1
    """Number of processes on this machine."""
    machine: Annotated[OmitArgPrefixes[MachineOptions], arg(name="expert run")] = MachineOptions()
    """These options set where runs take place, and how long each may take."""

    def run(self) -> None:
        from functools import partial

        from sim.parallel.pool import Pool
        from sim.stress.runner import run_trials
        from sim.stress.sweeps import SATURATED, saturated
        from tracker.io.progress import progress_bar
        from worlds.catalogue import check_name

        if self.show:
            self._show()
            return
        if self.out is None:
            raise ValueError("--out is missing, needs a folder for the results")
        check_name(self.scene.world or "", "--world")
        self._check_detector()
        pool, progress = Pool(self.workers, self.machine.cluster), partial(progress_bar, desc="runs", unit="run", smoothing=0.1)
        rows = run_trials(self._trials(), self.out, self._command(), pool, self.machine.limit, progress)
        if self.json:
            for row in rows:
                print(json_text(row))
            return
        failed = [row for row in rows if row["error"]]
        print(f"{self.out}: {len(rows)} run{'s' * (len(rows) != 1)} in results.jsonl; `pilsim report {self.out}` makes a page of them")
        for name in saturated(rows):
            print(f"warning: every MOTA and IDF1 of the sweep {name} is above {SATURATED}: it tells nothing, needs harder values or another sweep")
        for row in failed[:10]:
            print(f"failed: {row['id']} seed {row['seed']}: {row['error']}")
        if len(failed) > 10:
            print(f"and {len(failed) - 10} more")

    def _check_detector(self) -> None:
        """Raises ValueError for --detector pixels without rendering, and for a model that cannot be used."""
        if self.boxes.pixels:
            from tracker.person_detector.network import PersonNetwork

            if not self.render or self.pets is not None or self.recording is not None:
                raise ValueError("--detector pixels needs rendered panoramas, without --no-render, --pets and --recording")
            PersonNetwork(self.boxes.model)

    def _cases(self) -> list[Case]:
        from sim.stress.sweeps import cases, default_scenario, pets_cases, recording_cases
        from tracker.detector_models.model import INDEPENDENT, chosen_model
        from tracker.formats.opening import open_recording

        if self.pets is not None and not self.pets.is_dir():
            raise ValueError(f"{self.pets}: no such folder")
        rovers, chosen = self.rovers, given(self.scene) | {"detector_model": chosen_model(self.boxes.detector_model)}
        chosen |= {"camera": rovers.camera, "effects": ",".join(rovers.effect), "speed": rovers.speed}
        start = replace(default_scenario(self.frames, self.width), **chosen)
        if self.recording is not None:
            if self.pets is not None:
                raise ValueError("--recording and --pets exclude each other")
            if self.boxes.detector_model != INDEPENDENT:
                raise ValueError("--detector-model is for simulated runs, and --recording has boxes of its own")
            recording = open_recording(self.recording)
            if recording.truth is None:
                raise ValueError(f"{self.recording}: has no truth, which a stress test needs")
            return recording_cases(self.sweep, str(self.recording.resolve()), len(recording.cameras), start)
        pets = [] if self.pets is None else pets_cases(str(self.pets.resolve()), start)
        named = [case for case in pets if case.id in self.sweep]
        others = [name for name in self.sweep if name not in {case.id for case in named}]
        swept = [] if pets and not others else cases(others, start)
        if not self.render:
            self._check_no_render(swept)
        return swept + (named or pets)

    def _check_no_render(self, chosen: list[Case]) -> None:
        """Raises ValueError for a sweep, a camera or an effect that needs images."""
        from sim.stress.sweeps import IMAGE_SWEEPS

        for case in chosen:
            pixels = [name for name in case.scenario.camera_effects.given() if name not in ("mount_angle", "mount_shift")]
            if case.sweep in IMAGE_SWEEPS or case.scenario.camera or pixels:
                what = f"--sweep {case.sweep}" if case.sweep in IMAGE_SWEEPS else "--camera" if case.scenario.camera else f"--effect {pixels[0]}"
                raise ValueError(f"{what} changes images, needs a run without --no-render")

    def _trials(self) -> list[Trial]:
        """All trials, ordered by seed, so that an interrupted run has all settings of the first seeds."""
        from sim.stress.runner import Trial

        assert self.out is not None
        tracker, out, cases, made = self.subject.chosen(), self.out.resolve(), self._cases(), []
        for seed in range(self.first_seed, self.first_seed + self.seeds):
            for case in cases:
                # The real sequence is the same for every seed.
                if case.source != "pets" or seed == self.first_seed:
                    pets = self.pets if case.source in ("pets", "twin") else None
                    command = replace(self, sweep=(case.id,), seeds=1, first_seed=seed, workers=1, pets=pets)._command()
                    model = "" if self.boxes.model is None else str(self.boxes.model.resolve())
                    made.append(Trial(case.with_seed(seed), tracker, out, self.render, self.ablation, command, self.boxes.pixels, model))
        return made

    def _show(self) -> None:
        from sim.stress.sweeps import KNOWN_SWEEPS

        if self.json:
            for case in self._cases():
                print(case.to_json())
            return
        for sweep in KNOWN_SWEEPS.values():
            values = ", ".join(map(str, sweep.values)) if not isinstance(sweep.values[0], str) else "; ".join(map(str, sweep.values))
            print(f"{sweep.name:12} {sweep.about}\n{'':12} {sweep.parameter}{f' ({sweep.unit})' if sweep.unit else ''}: {values}")

    def _command(self) -> str:
        """The command line of this run."""
        return command_line(self, ("show", "json"), repeated=("effect",))
