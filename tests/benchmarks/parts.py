"""What each part of the tracker of people gains on the population of `pilsim tune`: HOTA, MOTA and IDF1 without it, less those with it.

    python -m tests.benchmarks.parts --cases 60 --workers 2 --out runs/parts
    python -m tests.benchmarks.parts --parts "joint misses" "least fit" --cases 60 --out runs/parts

A part is left out by parameters, or by a function or constant of the code in its place. All parts are tried on the same cases, so that differences
are paired; intervals are of 95 %. What is done is kept in --out, and the same command goes on. A part takes some 2 s of processor time a case.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from joblib import Parallel, delayed

from sim.confidence_intervals import paired
from sim.tuning.case_file import VERSION
from sim.tuning.scoring import Candidate, CaseSource, score_case
from tracker.io.progress import progress_bar
from tracker.io.resume import Journal
from tracker.parameter_file import Value

FIGURES = ("hota", "mota", "idf1")
WITH = "all parts"


@dataclass(frozen=True)
class Without:
    """How a part is left out: parameters by path, and attributes of modules or classes by module:name."""

    values: Mapping[str, Value] = field(default_factory=dict)
    attributes: Mapping[str, Any] = field(default_factory=dict)


def _nothing(*_: Any) -> None:
    return None


def _children_alone(children: Any, _others: Any) -> Any:
    return children


def _pose_alone(_: Any, pose: Any, *__: Any) -> Any:
    return pose


PARTS: dict[str, Without] = {
    WITH: Without(),
    "appearance of feet ahead of the body": Without({"fusion.ahead": 0.0}),
    "attitude of robots by people": Without(attributes={"tracker.pipeline:corrected_pose": _pose_alone}),
    "bodies exclude each other": Without({"body": 0.0}),
    "covering share of partly visible people": Without(attributes={"tracker.tracks.detection_rates:DetectionRates.learn_partly_visible": _nothing}),
    "doubt by other views": Without(attributes={"tracker.mht.tracker:SUPPORTED": 1.0}),
    "existence ends by itself": Without({"residence": 1e9}),
    "joint assignment": Without(attributes={"tracker.mht.tracker:union": _children_alone}),
    "joint misses": Without({"joint_misses": 1e6}),
    "least fit": Without({"least_fit": -50.0}),
    "margin of uncontested boxes": Without({"uncontested_margin": 15.0}),
    "measurement noise": Without({"noise.excess": 0.0}),
    "misses have a common cause": Without({"miss_time": 1e-6}),
    "registration bias": Without({"registration_bias.sigma": 0.0, "registration_bias.first": 0.0}),
    "re-identification": Without({"reidentification.memory": 0.0}),
    "standing clutter": Without({"standing_clutter": False}),
    "things that look like people": Without({"thing": 1.0}),
    "walkable prior": Without(attributes={"tracker.detections.walkable_prior:WalkablePrior.of": staticmethod(_nothing)}),
}


def scores(case: int, source: CaseSource, part: str) -> dict[str, float]:
    """Figures of a case without a part. Raises ValueError where the tracker fails."""
    without = PARTS[part]
    with ExitStack() as stack:
        for path, value in without.attributes.items():
            module, name = path.split(":")
            stack.enter_context(patch(f"{module}.{name}", value))
        found = score_case(source, case, Candidate("", without.values))
    if "error" in found:
        raise ValueError(f"{part}: {found['error']}")
    return {name: float(found[name]) for name in (*FIGURES, "seconds")}


def main(words: Iterable[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", nargs="+", default=list(PARTS), choices=PARTS, metavar="PART")
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--population", type=Path, help="folder of cases that are drawn already (default: in --out)")
    parser.add_argument("--out", type=Path, default=Path("runs/parts"))
    options: Any = parser.parse_args(None if words is None else list(words))
    options.out.mkdir(parents=True, exist_ok=True)
    source = CaseSource(options.population or options.out / "cases", options.seed)
    # Scores of another seed or version of the cases are not those of these cases.
    journal = Journal(options.out / "scores.jsonl", {"seed": options.seed, "population": VERSION})
    done = {(entry["part"], entry["case"]): entry["figures"] for entry in journal.entries}
    wanted = [WITH, *(part for part in options.parts if part != WITH)]
    left = [(part, case) for case in range(options.cases) for part in wanted if (part, case) not in done]
    runs = Parallel(n_jobs=options.workers, return_as="generator")(delayed(scores)(case, source, part) for part, case in left)
    with journal:
        for (part, case), found in progress_bar(zip(left, runs, strict=True), total=len(left), desc="runs"):
            done[part, case] = found
            journal.add({"part": part, "case": case, "figures": found})
    print(f"{'without':40} {'time':>5}  " + "  ".join(f"{name:28}" for name in FIGURES))
    for part in wanted[1:]:
        print(row(part, {of: [done[of, case] for case in range(options.cases)] for of in (WITH, part)}))
    return 0


def row(part: str, found: Mapping[str, list[dict[str, float]]]) -> str:
    """A line of the table; found: figures by case, with all parts and without this one."""
    before, after = found[WITH], found[part]
    seconds = [np.sum([one["seconds"] for one in of]) for of in (before, after)]
    cells = []
    for name in FIGURES:
        counted = [{k: one[name] for k, one in enumerate(of) if one[name] == one[name]} for of in (before, after)]
        gain = paired(*counted)
        cells.append("" if gain is None else gain.text(4, signed=True))
    return f"{part:40} {seconds[1] / seconds[0]:5.2f}  " + "  ".join(f"{cell:28}" for cell in cells)


if __name__ == "__main__":
    sys.exit(main())
