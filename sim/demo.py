"""The whole way once: make a Sequence, track it, score it, and leave scores and pictures in a folder."""

from __future__ import annotations

import json
import shutil
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from tqdm import tqdm

from sim.record import record
from sim.scenario import Scenario
from tracker.atomic import unfinished, write_text
from tracker.evaluation import evaluate, table
from tracker.io.resume import check_same, holds, json_value
from tracker.pipeline import Parameters
from tracker.results import Results, read_results
from tracker.run import tracked
from tracker.sequence import Sequence, read_json, read_sequence

STATEMENT = "sequence/scenario.json"
PICTURES = ("contact_sheet.png", "plan.png", "video.mp4")


def run_demo(scenario: Scenario, out: Path) -> dict[str, Any]:
    """Returns the scores. What is in `out` of the same scenario is used again, each part by itself.

    Raises ValueError where `out` holds another run.
    """
    check_folder(scenario, out)
    folder = out / "sequence"
    if not folder.exists():
        record(scenario, folder, partial(tqdm, desc="panoramas", unit="frame"))
    sequence = read_sequence(folder)
    if (out / "track").exists() and read_results(out / "track").run.get("parameters") != json_value(Parameters()):
        print(f"{out / 'track'}: made with other parameters of the tracker; tracking anew")
        for name in PICTURES:
            (out / name).unlink(missing_ok=True)
        shutil.rmtree(out / "track")
    results = tracked(sequence, out / "track", {"source": "sequence", "views": []})
    scores = evaluate(sequence, results)
    write_text(out / "scores.json", json.dumps(scores, indent=1) + "\n")
    draw(sequence, results, scores, out)
    print(table(scores))
    for name, what in (
        ("scores.json", "all scores"),
        ("contact_sheet.png", "panoramas with estimated boxes"),
        ("plan.png", "true and estimated paths"),
        ("video.mp4", "both, moving"),
        ("sequence/", "panoramas, instances, truth, odometry, calibration (README.md in it)"),
        ("track/", "estimated tracks and poses"),
    ):
        print(f"{out / name}: {what}")
    return scores


def check_folder(scenario: Scenario, out: Path) -> None:
    """Refuse a folder that holds anything but this scenario's run."""
    if holds(out, STATEMENT, (unfinished(out / "sequence").name,)):
        there = read_json(out / STATEMENT)
        if not isinstance(there, dict):
            raise ValueError(f"{out / STATEMENT}: no scenario")
        check_same(out, there, json.loads(scenario.to_json()))


def draw(sequence: Sequence, results: Results, scores: dict[str, Any], out: Path) -> None:
    """Contact sheet, plan and video; pictures that are there stay."""
    # Matplotlib takes a second to import: only who draws shall wait for it.
    from sim.pictures import annotated, contact_sheet, plan, save_png, video_frames, write_video

    people, robots = scores["targets"], scores["robots"]
    title = f"MOTA {people['mota'] or 0:.3f}, IDF1 {people['idf1'] or 0:.3f}; robots {robots['ate_m']:.3f} m off"
    title += f" (dead reckoning {scores['dead_reckoning']['ate_m']:.3f} m)"
    if not (out / "contact_sheet.png").exists():
        chosen = 2 * len(sequence.ticks) // 3
        tick = next(islice(iter(sequence.ticks), chosen, None))
        save_png(out / "contact_sheet.png", contact_sheet(annotated(sequence, results, tick), f"frame {tick.index}: estimated boxes and ids"))
    if not (out / "plan.png").exists():
        plan(sequence, results, title, out / "plan.png")
    if not (out / "video.mp4").exists():
        ticks = tqdm(sequence.ticks, total=len(sequence.ticks), desc="video", unit="frame")
        write_video(out / "video.mp4", video_frames(sequence, results, ticks), 1 / sequence.setup.period)
