"""Accuracy of the tracker of people on PETS 2009, real rooms, a synthetic room and crowds among moving robots, one line a row.

A line has MOTA / IDF1 (id switches) of the whole recording, its misses and false positives, MOTP and processor time of tracking. Brackets have MOTA /
IDF1 of the part on which parameters may be tuned, and of the other; on CMC then of the area with complete truth. Rows of several runs have means,
and the standard deviations of MOTA and IDF1 of the last part.
ROWS are regular expressions of whole names, or groups: pets, cmc, wildtrack, room, campus, ruins. Without ROWS, all rows run but crowds, which take
an hour.

`python -m tests.benchmarks.one_tracker pets-157 cmc --delay 10 --set residence=5 --set motion.foot_spread=0.3 --tuning`
"""

from __future__ import annotations

import argparse
import ast
import dataclasses
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Memory, Parallel, delayed

from sim.scenario import Scenario
from sim.stress.ablation import STAGES, with_true_stages
from sim.stress.sweeps import Case
from sim.stress.trial_data import TrialData, simulate_case
from tests.benchmarks.room import room
from tests.conftest import DATA
from tracker import parameter_file
from tracker.formats.opening import open_sequence
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array
from tracker.io.json_files import json_text
from tracker.metrics.clear_mot import score
from tracker.metrics.evaluation import matching_frames
from tracker.options import OPTIONS, parameters_from
from tracker.pipeline import Parameters, track
from tracker.recordings.degradation import BoxNoise, Degradation
from tracker.sequence.results import Results
from tracker.types import Sequence, Tick, TicksInMemory
from tracker.types.truth import evaluated_people

DELAY, ROOM_DELAY = 10, 5
"""Frames by which output lags: by default, and always in real rooms and squares."""
PETS_TUNED, CMC_TUNED, WILDTRACK_TUNED = 400, 130, 180
"""First frame on which nothing may be tuned."""
SEEDS, TUNING_SEEDS = (100, 109), (20, 22)
ROOM_SEEDS, TUNING_ROOM_SEEDS = range(100, 105), range(5)
FRAMES = 120
CROWDS = (("campus", 43), ("campus", 74), ("ruins", 10), ("ruins", 43), ("ruins", 74))
GROUPS = ("pets", "cmc", "wildtrack", "room", "campus", "ruins")
CMC_AREA = ((1.8, 0.0), (7.67, 3.41))
"""Lowest and highest x, y, m, where the truth of CMC is complete: beside it people wait."""
DROPPED = 0.02
"""Share of the boxes that a draw leaves out: in rooms, a single run is uncertain by 0.03 of IDF1."""
LEAST = 0.3
"""The transforms of ONE_NUMBER drop boxes of less confidence."""
ONE_NUMBER = {"constant": 0.95, "none": -1.0}
TRANSFORMS = ("square", "root", "affine", "log", *ONE_NUMBER)
FIGURES = ("mota", "idf1", "switches", "misses", "false_positives", "motp_m", "truths")


@dataclass(frozen=True)
class Source:
    """What is tracked in a run: a folder with its options, or a seed of the synthetic room, or of a crowd (world, people)."""

    path: Path | None = None
    options: SourceOptions = field(default_factory=SourceOptions)
    seed: int = 0
    world: str = ""
    people: int = 0
    frames: int | None = None
    true_poses: bool = False
    cache: Path | None = None
    area: tuple[tuple[float, float], tuple[float, float]] | None = None

    def open(self) -> Sequence:
        if self.path is not None:
            return open_sequence(self.path, self.options)
        return self._crowd() if self.world else self._room()

    def _room(self) -> Sequence:
        recording = room(self.seed)
        return (recording if self.frames is None else recording.cut(0, self.frames)).sequence()

    def _crowd(self) -> Sequence:
        """Four rovers by ray casting, as in crowds.py."""
        scenario = Scenario(world=self.world, people=self.people, frames=self.frames or FRAMES, seed=self.seed)
        data = Memory(self.cache, verbose=0).cache(simulated)(scenario)
        setup, ticks, _ = with_true_stages(data, dict.fromkeys(STAGES, False) | {"poses": self.true_poses})
        return Sequence(setup, TicksInMemory(tuple(ticks), setup.mounts), data.truth, {})


def simulated(scenario: Scenario) -> TrialData:
    """What the tracker gets of a crowd, and the truth of robots and people."""
    data = simulate_case(Case("crowd/0", "crowd", "people", scenario.people, scenario), rendered=False)
    return replace(data, recorded=[], views=[], person={})


@dataclass(frozen=True)
class Row:
    """A line of the table: its runs by name, the first frame that is not for tuning (None where there is none), and its own delay, if any."""

    name: str
    runs: Mapping[str, Source]
    tuned: int | None = None
    delay: int | None = None

    @property
    def group(self) -> str:
        return self.name.split("-")[0].rstrip("12")


@dataclass(frozen=True)
class Outcome:
    """Figures (FIGURES by name) of the whole recording and of its parts by name, and processor time of tracking, s."""

    whole: dict[str, float]
    parts: dict[str, dict[str, float]]
    seconds: float


def all_rows(tuning: bool, seeds: range, crowd: Source) -> list[Row]:
    """All rows; tuning: of the parts for tuning alone. seeds, crowd: of the crowds, and what is common to them."""
    rows = [*pets_rows(tuning), *cmc_rows(tuning)]
    for misses in (0.1, 0.5):
        options = SourceOptions(frames=(0, WILDTRACK_TUNED) if tuning else None, projected=BoxNoise(misses, 0.02))
        rows.append(Row(f"wildtrack-{misses}", {"": Source(DATA / "wildtrack", options)}, WILDTRACK_TUNED, ROOM_DELAY))
    rows += [Row(f"room-{seed}", {"": Source(seed=seed)}) for seed in (TUNING_ROOM_SEEDS if tuning else ROOM_SEEDS)]
    for world, people in CROWDS:
        rows.append(Row(f"{world}-{people}", {str(k): replace(crowd, seed=k, world=world, people=people) for k in seeds}))
    return rows


def pets_rows(tuning: bool) -> Iterator[Row]:
    folder, frames = DATA / "pets2009" / "S2.L1", (0, PETS_TUNED) if tuning else None
    det = {"1": folder / "mot15" / "det.txt"}
    half, seeds = Degradation(drop=0.5), tuple(range(5))
    views: dict[str, tuple[str, Mapping[str, Path], Degradation, tuple[int, ...]]] = {
        "157": ("157", {}, Degradation(), (0,)),
        "all": ("", {}, Degradation(), (0,)),
        "low": ("5678", {}, Degradation(), (0,)),
        "1": ("1", {}, Degradation(), (0,)),
        "det": ("1", det, Degradation(), (0,)),
        "157-det": ("157", det, Degradation(), (0,)),
        "half": ("157", {}, half, seeds),
    }
    for images in (False, True):
        for name, (cameras, files, degradation, drawn) in views.items():
            runs = {
                str(seed) if len(drawn) > 1 else "": Source(folder, SourceOptions(tuple(cameras), files, frames, degradation, seed, images))
                for seed in drawn
            }
            yield Row(f"pets-{name}{'-images' if images else ''}", runs, PETS_TUNED)


def cmc_rows(tuning: bool) -> Iterator[Row]:
    for detector, folder in (("fairmot", "detections"), ("rcnn", "detections-faster-rcnn")):
        for place in ("cmc1", "cmc2"):
            path = DATA / "cmc" / place.upper()
            files = {} if detector == "fairmot" else {"": path / folder}
            options = SourceOptions(detections=files, frames=(0, CMC_TUNED) if tuning else None)
            yield Row(f"{place}-{detector}", {"": Source(path, options, area=CMC_AREA)}, CMC_TUNED, ROOM_DELAY)


def chosen_rows(patterns: Iterable[str], rows: list[Row]) -> list[Row]:
    """The rows that patterns name, in the order of `rows`. Raises ValueError for a pattern that names none."""
    given = list(patterns)
    if not given:
        return [row for row in rows if row.group not in ("campus", "ruins")]
    kept: set[str] = set()
    for pattern in given:
        try:
            found = {row.name for row in rows if re.fullmatch(pattern, row.name) or pattern in (row.group, row.name.split("-")[0])}
        except re.error as error:
            raise ValueError(f"row is {pattern!r}, needs a regular expression: {error}") from None
        if not found:
            raise ValueError(f"row is {pattern!r}, needs one of {', '.join(row.name for row in rows)}, a regular expression, or {', '.join(GROUPS)}")
        kept |= found
    return [row for row in rows if row.name in kept]


def drawn(row: Row, draws: int) -> Row:
    """The row with so many runs of each recording, of which each lacks other boxes; with 0 draws, the row as it is."""
    runs = dict[str, Source]()
    for name, source in row.runs.items():
        if not draws or source.path is None:
            runs[name] = source
            continue
        of = source.options
        fewer = replace(of.degradation, drop=1 - (1 - of.degradation.drop) * (1 - DROPPED))
        runs |= {f"{name}+{k}": replace(source, options=replace(of, degradation=fewer, seed=of.seed + k)) for k in range(draws)}
    return replace(row, runs=runs)


def transformed(ticks: Iterable[Tick], name: str) -> Iterator[Tick]:
    """The ticks with other confidences, by one of TRANSFORMS: c², √c, 0.3 + 0.7 c, −log(1.0001 − c), or ONE_NUMBER for boxes of at least LEAST."""
    functions: dict[str, Callable[[Array], Array]] = {
        "square": lambda c: np.sign(c) * c**2,
        "root": lambda c: np.sign(c) * np.sqrt(np.abs(c)),
        "affine": lambda c: 0.3 + 0.7 * c,
        "log": lambda c: -np.log(np.maximum(1.0001 - c, 1e-4)),
    }
    for tick in ticks:
        views = []
        for view in tick.views:
            d = view.detections
            kept = d.confidence >= LEAST if name in ONE_NUMBER else np.ones(len(d), dtype=bool)
            arrays = {f.name: getattr(d, f.name)[kept] for f in dataclasses.fields(d)}
            c = arrays["confidence"]
            arrays["confidence"] = np.full(len(c), ONE_NUMBER[name]) if name in ONE_NUMBER else functions[name](c)
            views.append(replace(view, detections=replace(d, **arrays)))
        yield replace(tick, views=tuple(views))


def with_fields(parameters: Parameters, settings: Iterable[str]) -> Parameters:
    """Parameters with other fields of the tracker of people; settings: FIELD=VALUE, dots before fields of parts. Raises ValueError for others."""
    people = parameters.targets
    for setting in settings:
        name, _, text = setting.partition("=")
        try:
            value = ast.literal_eval(text)
        except (ValueError, SyntaxError):
            value = text
        people = parameter_file.with_fields(people, {name: value}, f"--set is {setting!r}:")
    return replace(parameters, targets=people)


def outcome(source: Source, tuned: int | None, parameters: Parameters, transform: str | None) -> Outcome:
    """Track a source and score it as `pilsim score` does."""
    sequence = source.open()
    if sequence.truth is None:
        raise ValueError(f"{source.path}: no truth to score against")
    began = time.process_time()
    ticks = sequence.ticks if transform is None else transformed(sequence.ticks, transform)
    results = Results.of(track(sequence.setup, ticks, parameters), {})
    seconds = time.process_time() - began
    people = {t.index: (t.person_id, t.feet) for t in sequence.truth}
    frames = matching_frames(people, results.tracks, evaluated_people(sequence.truth, sequence.setup.period))
    parts = {} if tuned is None or tuned >= len(frames) else {"tuned": frames[:tuned], "untuned": frames[tuned:]}
    if source.area is not None:
        parts["area"] = [frame.within(np.array(source.area)) for frame in frames]

    def figures(chosen: list[Any]) -> dict[str, float]:
        found = score(chosen).to_dict()
        return {name: np.nan if (value := found[name]) is None else value for name in FIGURES}

    return Outcome(figures(frames), {name: figures(part) for name, part in parts.items()}, seconds)


def mean(outcomes: list[Outcome]) -> Outcome:
    """The means of all figures of runs with the same parts."""

    def of(found: list[dict[str, float]]) -> dict[str, float]:
        return {name: float(np.mean([f[name] for f in found])) for name in FIGURES}

    parts = {name: of([o.parts[name] for o in outcomes]) for name in outcomes[0].parts}
    return Outcome(of([o.whole for o in outcomes]), parts, sum(o.seconds for o in outcomes))


def text_of(name: str, found: Outcome, runs: list[Outcome]) -> str:
    """A line; of several runs, the least of MOTA and IDF1 too."""
    line = f"{name:20} {figures_text(found.whole)}  {found.seconds:6.1f} s"
    if found.parts:
        line += "  (" + "; ".join(f"{p['mota']:.3f} / {p['idf1']:.3f}" for p in found.parts.values()) + ")"
    if len(runs) > 1:
        last = [list({"": r.whole, **r.parts}.values())[-1] for r in runs]
        line += f"  least {min(f['mota'] for f in last):.3f} / {min(f['idf1'] for f in last):.3f}"
        line += f"  deviation {np.std([f['mota'] for f in last], ddof=1):.3f} / {np.std([f['idf1'] for f in last], ddof=1):.3f}"
    return line


def figures_text(f: Mapping[str, float]) -> str:
    misses, false = f["misses"], f["false_positives"]
    return f"{f['mota']:.3f} / {f['idf1']:.3f} ({f['switches']:g})  misses {misses:6g}  false {false:6g}  {f['motp_m']:.3f} m"


def report(name: str, runs: Mapping[str, Outcome], as_json: bool, parts: bool) -> None:
    """Print the line of a row at once, and with `parts` a line for each run and part."""
    found = mean(list(runs.values()))
    if as_json:
        each = {run: dataclasses.asdict(o) for run, o in runs.items()} if len(runs) > 1 else {}
        print(json_text({"row": name, **dataclasses.asdict(found), **({"runs": each} if each else {})}), flush=True)
        return
    print(text_of(name, found, list(runs.values())), flush=True)
    if parts:
        for part, figures in found.parts.items():
            print(f"  {part:18} {figures_text(figures)}", flush=True)
        for run, one in runs.items() if len(runs) > 1 else ():
            print(text_of(f"  {run}", one, [one]), flush=True)


def parser() -> argparse.ArgumentParser:
    """The options of the benchmark, and all those of the command `track` that set parameters."""
    out = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    out.add_argument("rows", nargs="*", metavar="ROWS")
    out.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", help="a field of the tracker's parameters; repeatable")
    out.add_argument("--transform", choices=TRANSFORMS, help="other confidences of all boxes")
    out.add_argument("--offsets", default="", help="offsets of cameras' clocks, as of `track`: auto")
    out.add_argument("--draws", type=int, default=0, help="runs of each recording, in each of which other 2 %% of the boxes are left out")
    out.add_argument("--tuning", action="store_true", help="only what parameters may be tuned on, cut before tracking")
    out.add_argument("--parts", action="store_true", help="a line for each part and run, too")
    out.add_argument("--json", action="store_true", help="a JSON object a row")
    out.add_argument("--seeds", nargs=2, type=int, metavar=("FIRST", "LAST"), help="of crowds, default 100 109, with --tuning 20 22")
    out.add_argument("--poses", choices=("SLAM", "true"), default="SLAM", help="of the robots among crowds")
    out.add_argument("--frames", type=int, default=FRAMES, help="of crowds")
    out.add_argument("--cache", type=Path, metavar="DIR", help="keeps simulated crowds; delete it where the simulator changes")
    out.add_argument("--workers", type=int, default=1)
    for name, form in OPTIONS.items():
        if name != "images":  # a row says whether it has images
            out.add_argument(f"--{name.replace('_', '-')}", dest=name, type=form.kind, choices=form.choices or None)
    return out


def run(options: argparse.Namespace) -> None:
    """Run the chosen rows. Raises ValueError for options that do not fit."""
    first, last = options.seeds or (TUNING_SEEDS if options.tuning else SEEDS)
    if not 0 <= first <= last:
        raise ValueError(f"--seeds is {first} {last}, needs the first seed, then the last")
    if options.draws < 0 or options.frames < 1 or options.workers < 1:
        raise ValueError(f"--draws, --frames, --workers are {options.draws}, {options.frames}, {options.workers}, needs at least 0, 1, 1")
    crowd = Source(frames=options.frames, true_poses=options.poses == "true", cache=options.cache)
    rows = [drawn(row, options.draws) for row in chosen_rows(options.rows, all_rows(options.tuning, range(first, last + 1), crowd))]
    given = {name: getattr(options, name) for name in OPTIONS if name != "images"}
    jobs = []
    for row in rows:
        for source in row.runs.values():
            if options.offsets and source.path is not None:
                source = replace(source, options=replace(source.options, offsets=options.offsets))
            delay = row.delay if row.delay is not None else DELAY if options.delay is None else options.delay
            parameters = with_fields(parameters_from(given | {"delay": delay, "images": source.options.images}), options.set)
            jobs.append(delayed(outcome)(source, None if options.tuning else row.tuned, parameters, options.transform))
    found = Parallel(n_jobs=options.workers, return_as="generator")(jobs)
    rooms: dict[str, Outcome] = {}
    for k, row in enumerate(rows):
        runs = {name: next(found) for name in row.runs}
        report(row.name, runs, options.json, options.parts)
        if row.group == "room":
            rooms[row.name] = runs[""]
            if len(rooms) > 1 and all(other.group != "room" for other in rows[k + 1 :]):
                report("room, mean", rooms, options.json, False)


def main() -> int:
    try:
        run(parser().parse_args())
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
