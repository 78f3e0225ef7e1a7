"""Relocalization of lost robots from images, in generated sequences: the time until a robot has recovered its pose.

In mid-run, each robot is carried for 2 m with still wheels and a covered camera. In another run, its camera is covered for 3 s while it drives on.
A robot has recovered when its error stays below 0.3 m, or below 1.5 times the error before.

`python -m tests.benchmarks.lost SEQUENCE ...` prints a Markdown table.
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
from tracker.slam.image_features import ImageFeatures
from tracker.types import Detections, Sequence, Setup, Tick, View

CARRIED, BLIND, AFTERWARDS = 2.0, 3.0, 10.0
"""Distance, m; time without a camera, s; and time that is evaluated afterwards, s."""
RECOVERED = 0.3
"""Error of a robot that has recovered, m."""


def with_features(sequence: Sequence) -> list[Tick]:
    """The ticks with features in place of images, so that SIFT runs only once for all runs."""
    parameters, ticks = Parameters().slam, []
    features, slam = ImageFeatures(sequence.setup, parameters.features), Slam(sequence.setup, parameters)
    for tick in tqdm(sequence.ticks, total=len(sequence.truth or ()), desc="key points", leave=False):
        slam.step(features.find(tick))
        views = [replace(v, image=None, sightings=slam.sighted.get(v.camera)) for v in tick.views]
        ticks.append(replace(tick, views=tuple(views)))
    return ticks


def with_fault(setup: Setup, tick: Tick, robot: str, carried: bool) -> Tick:
    """The tick with a robot that sees nothing. Where it is carried, its odometry is zero."""

    def change(view: View) -> View:
        if setup.mounts[view.camera].robot != robot:
            return view
        odometry = view.odometry
        if carried and odometry is not None:
            odometry = replace(odometry, T_before_now=Pose.identity())
        return View(view.camera, Detections.none(), odometry=odometry)

    return replace(tick, views=tuple(change(v) for v in tick.views))


def errors(setup: Setup, ticks: Iterable[Tick], robot: str, places: Array) -> Array:
    """(n,) m: the position error of a robot at each tick. places: (n, 3) m, its true positions."""
    slam, out = Slam(setup, Parameters().slam), []
    for tick, place in zip(ticks, places, strict=False):
        slam.step(tick)
        out.append(float(np.linalg.norm(slam.pose(robot).translation - place)))
    return np.array(out)


def recovered_after(error: Array, first: int, last: int) -> int | None:
    """Ticks from the end of the fault, ticks `first` to `last` − 1, until the robot has recovered. None where it has not."""
    wrong = np.flatnonzero(error[last:] > max(RECOVERED, 1.5 * error[first - 1]))
    after = int(wrong[-1]) + 1 if len(wrong) else 0
    return after if after < len(error) - last else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sequences", nargs="+", type=Path, help="folders of generated sequences")
    print("| sequence | robot | fault | duration | error before | error at its end | recovered after | error 5 s after |")
    print("|---" * 8 + "|")
    for folder in parser.parse_args().sequences:
        sequence = read_sequence(folder)
        assert sequence.truth is not None
        ticks, period, start = with_features(sequence), sequence.setup.period, len(sequence.truth) // 2
        for robot in sequence.truth[0].T_world_robot:
            places = np.array([t.T_world_robot[robot].translation for t in sequence.truth])
            far = np.flatnonzero(np.linalg.norm(places[start:] - places[start], axis=1) >= CARRIED)
            for fault, length in (("carried", int(far[0]) if len(far) else 0), ("blinded", round(BLIND / period))):
                end = start + length
                if not length or end + round(AFTERWARDS / period) > len(ticks):
                    continue
                changed = [with_fault(sequence.setup, t, robot, fault == "carried") if start <= k < end else t for k, t in enumerate(ticks)]
                error = errors(sequence.setup, changed[: end + round(AFTERWARDS / period)], robot, places)
                after = recovered_after(error, start, end)
                cells = [folder.parent.name, robot, fault, f"{length * period:.1f} s", f"{error[start - 1]:.3f} m", f"{error[end - 1]:.2f} m"]
                cells += ["never" if after is None else f"{after * period:.1f} s", f"{error[end + round(5 / period) - 1]:.3f} m"]
                print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
