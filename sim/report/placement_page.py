"""The page of a comparison of policies that place robots: means, paired differences, and videos of the best and the worst episodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sim.confidence_intervals import Interval
from sim.placement.plan_view import draw_plan
from sim.policies.rollouts import MEASURES_SHOWN, TITLES, EpisodeResult, differences, play, short_name, table
from sim.report.findings import plural
from sim.report.page import PageMoment, PageTable, render, video
from tracker.io.atomic import write_text
from tracker.io.progress import progress_bar

PAGE = "index.html"
FRAMES, WIDTH, QUALITY = 120, 480, 60
"""Largest number of frames of a video, evenly spread; its width, px; quality of WebP."""
SECONDS = 0.125
"""s: duration of a frame. The video runs four times as fast as the episode."""
LABELS = {"hota": "HOTA", "idf1": "IDF1", "mota": "MOTA", "ate_m": "ATE m"}
"""Measures whose label is more than their name."""
GLOSSARY = (
    ("Information", "expected information about the place of a person, nats: 0 for somebody lost, 5 to 6 for somebody seen well."),
    ("HOTA, IDF1, MOTA", "scores of the tracker on the ground with distances of at most 1 m. Everybody counts, seen or not."),
    ("Seen, seen twice", "shares of people whom at least one robot sees, and two."),
    ("ATE, way", "error of the robots' estimated paths, and length of the way that a robot drove, m."),
    ("Difference", "a policy less the first one in the same episodes. The interval has 95 %. Where it holds 0, no difference is seen."),
)
ABOUT_EPISODES = (
    "The best and the worst episode of each policy, four times as fast as they are. People are green where two robots see them,"
    " amber where one does, red where none does. Arrows are robots, crosses their goals. Ellipses show two standard deviations of people."
)


@dataclass(frozen=True, eq=False)
class PlacementRun:
    """The episodes that were played: results by world, options of the environment without the world, decisions of an episode, and the command."""

    results: Mapping[str, Sequence[EpisodeResult]]
    options: Mapping[str, Any]
    steps: int
    command: str

    def options_in(self, world: str) -> dict[str, Any]:
        """Options of the environment for the results of a world. Those of a preset in its own world bear the name of the preset."""
        return dict(self.options) if world == self.options.get("density") else {**self.options, "world": world}


def write_placement_page(run: PlacementRun, folder: Path) -> Path:
    """Write index.html into a folder. The best and the worst episodes are played again. Returns the path of the page."""
    target = folder / PAGE
    write_text(target, render(_names(run)))
    return target


def _names(run: PlacementRun) -> dict[str, Any]:
    """Name → value of each variable of the template."""
    moments = [moment for world, results in run.results.items() for moment in _moments(run, world, results)]
    count = sum(map(len, run.results.values()))
    return {
        "title": f"Placement: {', '.join(run.results)}",
        "kicker": "pilsim place",
        "heading": "Where robots should go so that people stay tracked",
        "headline": " ".join(_headline(world, results) for world, results in run.results.items()),
        "headings": {"moments": "Best and worst episodes"},
        "summary": [("Episodes", f"{count} of {run.steps} decisions each, two a second."), ("Options", _options(run.options))],
        "about_moments": ABOUT_EPISODES,
        "moments": moments,
        "tables": [(world, list(_tables(world, results))) for world, results in run.results.items()],
        "glossary": GLOSSARY,
        "about_commands": "The same command plays the same episodes.",
        "commands": run.command,
        "made_by": "pilsim place",
        "made_from": plural(count, "episode"),
    }


def _options(options: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {str(value)[:40]}" for name, value in options.items()) or "the usual ones"


def _measure(results: Sequence[EpisodeResult]) -> str:
    """The measure by which episodes are ranked: HOTA where the tracker is in the loop."""
    return "hota" if "hota" in results[0].values else "information"


def _headline(world: str, results: Sequence[EpisodeResult]) -> str:
    measure, found, less = _measure(results), table(results), differences(results)
    ranked = sorted(found, key=lambda name: -found[name][measure].mean)
    first = f"In {world}, {short_name(ranked[0])} has the highest mean: {TITLES[measure].split(' [')[0]} {found[ranked[0]][measure].text(3)}."
    compared = next((name for name in ranked if measure in less.get(name, {})), None)
    if compared is None:
        return first
    difference = less[compared][measure]
    seen = "" if difference.verdict in ("higher", "lower") else f": {difference.verdict}"
    return f"{first} {short_name(compared)} less {short_name(results[0].policy)} is {difference.text(3, signed=True)}{seen}."


def _label(measure: str) -> str:
    return LABELS.get(measure, measure.replace("_", " "))


def _tables(world: str, results: Sequence[EpisodeResult]) -> Iterator[PageTable]:
    found, less = table(results), differences(results)
    shown = [measure for measure in MEASURES_SHOWN if measure in results[0].values]
    head = ("policy", *map(_label, shown))

    def rows(of: Mapping[str, Mapping[str, Interval]], signed: bool) -> list[tuple[str, ...]]:
        return [(short_name(name), *(row[measure].text(3, signed=signed) for measure in shown)) for name, row in of.items()]

    taken = {name: float(np.mean([one.act_ms for one in results if one.policy == name])) for name in found}
    body = [(*row, f"{taken[name]:.1f}") for row, name in zip(rows(found, False), found, strict=True)]
    yield PageTable(f"Means over episodes with 95 % intervals: {world}", (*head, "ms a decision"), tuple(body))
    if less:
        yield PageTable(f"Differences from {short_name(results[0].policy)}, paired by seed: {world}", head, tuple(rows(less, True)))


def _moments(run: PlacementRun, world: str, results: Sequence[EpisodeResult]) -> Iterator[PageMoment]:
    measure = _measure(results)
    for name in progress_bar(list(dict.fromkeys(result.policy for result in results)), desc=f"videos, {world}", unit=" policies", leave=False):
        own = sorted((result for result in results if result.policy == name), key=lambda result: result.values[measure])
        for which, result in [("best", own[-1]), ("worst", own[0])] if len(own) > 1 else [("only", own[0])]:
            heading = f"The {which} episode of {short_name(name)} in {world}"
            values = ", ".join(f"{_label(one)} {result.values[one]:.3f}" for one in MEASURES_SHOWN if one in result.values)
            moving = video(_played(run, world, result), SECONDS, QUALITY)
            yield PageMoment(heading, f"Seed {result.seed}: {values}.", (moving,), (f"{heading}: plan view, a video",), ())


def _played(run: PlacementRun, world: str, result: EpisodeResult) -> list[Any]:
    """Plan views (h, WIDTH, 3) RGB along an episode, which is played again."""
    wanted = set(np.linspace(1, run.steps, min(FRAMES, run.steps)).round().astype(int).tolist())
    out = []
    for k, episode in enumerate(play(result.policy, result.seed, run.options_in(world), run.steps)):
        if k in wanted:
            picture = draw_plan(episode)
            out.append(cv2.resize(picture, (WIDTH, round(WIDTH * picture.shape[0] / picture.shape[1])), interpolation=cv2.INTER_AREA))
    return out
