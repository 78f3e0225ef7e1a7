"""Robots that lose their way, from pixels: in mid-run each robot of a generated sequence is carried 2 m with its wheels still and its camera covered,
and in another run blinded for 3 s while it drives on; how long after that it knows again where it is.

`python -m tests.benchmarks.lost SEQUENCE ...`; a Markdown table. Found is who errs from then on by less than 0.3 m, or half more than before.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from tracker.geometry import Array, Pose
from tracker.pipeline import Parameters
from tracker.sequence.reader import read_sequence
from tracker.slam.filter import Slam
from tracker.types import Detections, Sequence, Setup, Tick, View

FAR, BLIND, WATCHED = 2.0, 3.0, 10.0
"""m, s, and s that are looked at afterwards."""
NEAR = 0.3
"""m."""


def looked(sequence: Sequence) -> list[Tick]:
    """The ticks with what is seen in the panoramas in the place of these: SIFT is done once for all runs."""
    slam, ticks = Slam(sequence.setup, Parameters().slam), []
    for tick in tqdm(sequence.ticks, total=len(sequence.truth or ()), desc="key points", leave=False):
        slam.step(tick)
        views = [replace(v, image=None, sightings=slam.sighted.get(v.camera)) for v in tick.views]
        ticks.append(replace(tick, views=tuple(views)))
    return ticks


def troubled(setup: Setup, tick: Tick, robot: str, carried: bool) -> Tick:
    """The tick with a robot that sees nothing and, where it is carried, whose wheels say that it stands."""

    def change(view: View) -> View:
        if setup.mounts[view.camera].robot != robot:
            return view
        odometry = view.odometry
        if carried and odometry is not None:
            odometry = replace(odometry, T_before_now=Pose.identity())
        return View(view.camera, Detections.none(), odometry=odometry)

    return replace(tick, views=tuple(change(v) for v in tick.views))


def errors(setup: Setup, ticks: Iterable[Tick], robot: str, places: Array) -> Array:
    """(n,) m: how far the robot is off."""
    slam, out = Slam(setup, Parameters().slam), []
    for tick, place in zip(ticks, places, strict=False):
        slam.step(tick)
        out.append(float(np.linalg.norm(slam.pose(robot).translation - place)))
    return np.array(out)


def found_after(error: Array, first: int, last: int) -> int | None:
    """Ticks from the end of the trouble, which lasted from `first` to before `last`, until the robot knows where it is; None where it never does."""
    wrong = np.flatnonzero(error[last:] > max(NEAR, 1.5 * error[first - 1]))
    after = int(wrong[-1]) + 1 if len(wrong) else 0
    return after if after < len(error) - last else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sequences", nargs="+", type=Path, help="folders of generated sequences")
    print("| sequence | robot | trouble | lasts | off before | at its end | found after | 5 s after |\n|---|---|---|---|---|---|---|---|")
    for folder in parser.parse_args().sequences:
        sequence = read_sequence(folder)
        assert sequence.truth is not None
        ticks, period, start = looked(sequence), sequence.setup.period, len(sequence.truth) // 2
        for robot in sequence.truth[0].T_world_robot:
            places = np.array([t.T_world_robot[robot].translation for t in sequence.truth])
            far = np.flatnonzero(np.linalg.norm(places[start:] - places[start], axis=1) >= FAR)
            for trouble, length in (("carried", int(far[0]) if len(far) else 0), ("blinded", round(BLIND / period))):
                end = start + length
                if not length or end + round(WATCHED / period) > len(ticks):
                    continue
                changed = [troubled(sequence.setup, t, robot, trouble == "carried") if start <= k < end else t for k, t in enumerate(ticks)]
                error = errors(sequence.setup, changed[: end + round(WATCHED / period)], robot, places)
                after = found_after(error, start, end)
                cells = [folder.parent.name, robot, trouble, f"{length * period:.1f} s", f"{error[start - 1]:.3f} m", f"{error[end - 1]:.2f} m"]
                cells += ["never" if after is None else f"{after * period:.1f} s", f"{error[end + round(5 / period) - 1]:.3f} m"]
                print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
