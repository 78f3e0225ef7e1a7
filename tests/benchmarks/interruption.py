"""Interruption of one sequence: the same manifest with 1, 2 and 3 workers, and after SIGKILL or Ctrl-C at ten random moments.

    python -m tests.benchmarks interruption

A moment is a random frame, and a random time within it. Each run is a process that is forked from this one, so that Linux is needed.
Exit code 1 where a manifest differs or a process is left.
"""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path

from sim.recording.drawing import drawing_workers
from sim.recording.frame_journal import NAME
from sim.recording.record import SimulatedSequence, write_sequence
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tracker.io.atomic import partial_path

SCENARIO = Scenario(seed=38, frames=40, width=256, robots=2, people=4)
KINDS = ((signal.SIGKILL, 1, 10), (signal.SIGINT, 1, 10), (signal.SIGKILL, 2, 3), (signal.SIGINT, 2, 3))
"""Signal, workers, and times that it is sent."""
PATIENCE = 10.0
"""s within which all processes of an interrupted run must have ended."""


def start(simulation: Simulation, folder: Path, workers: int) -> int:
    """Write the sequence in a new process, the first of its group. Its exit code is 130 after Ctrl-C."""
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        os.setsid()
        with drawing_workers(workers) as drawing:
            write_sequence(SimulatedSequence(simulation, {}, json.loads(SCENARIO.to_json()), workers=drawing), folder)
        code = 0
    except KeyboardInterrupt:
        code = 130
    finally:
        os._exit(code)


def checksum(folder: Path) -> str:
    return str(json.loads((folder / "manifest.json").read_text())["sum"])


def drawn(folder: Path) -> int:
    """The number of frames in the journal of an unfinished sequence."""
    try:
        return max(0, (partial_path(folder) / NAME).read_bytes().count(b"\n") - 1)
    except OSError:
        return 0


def group(leader: int) -> list[int]:
    """Processes of a group that have not ended."""
    out = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, number = path.read_text().rpartition(") ")[2].split()[:3]
        except OSError:
            continue
        if int(number) == leader and state not in "ZX":
            out.append(int(path.parent.name))
    return out


def interrupted(simulation: Simulation, folder: Path, kind: tuple[signal.Signals, int, int]) -> tuple[list[int], int, int]:
    """Interrupt the writing at random moments, then finish it: frames on disk after each interruption, processes left, other exit codes."""
    number, workers, times = kind
    chance, frames, left, odd = random.Random(number + workers), [], 0, 0
    for moment in sorted(chance.sample(range(SCENARIO.frames - 1), times)):
        child = start(simulation, folder, workers)
        while drawn(folder) < moment and not os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT):
            time.sleep(0.002)
        time.sleep(chance.uniform(0.0, 0.1))
        # A terminal sends Ctrl-C to all processes of the group; a kill reaches one.
        if number == signal.SIGINT:
            os.killpg(child, number)
        else:
            os.kill(child, number)
        _, status = os.waitpid(child, 0)
        odd += os.waitstatus_to_exitcode(status) not in ((130, 0) if number == signal.SIGINT else (-number, 0))
        deadline = time.monotonic() + PATIENCE
        while group(child) and time.monotonic() < deadline:
            time.sleep(0.02)
        left += len(group(child))
        frames.append(drawn(folder))
    if not (folder / "manifest.json").exists():
        os.waitpid(start(simulation, folder, workers), 0)
    return frames, left, odd


def main() -> None:
    simulation, faults = Simulation(SCENARIO), 0
    with tempfile.TemporaryDirectory() as name:
        sums = []
        for workers in (1, 2, 3):
            folder = Path(name, f"workers-{workers}")
            os.waitpid(start(simulation, folder, workers), 0)
            sums.append(checksum(folder))
            print(f"{workers} workers: {sums[-1][:16]}", flush=True)
        faults += len(set(sums)) - 1
        for kind in KINDS:
            folder = Path(name, f"{kind[0].name}-{kind[1]}")
            frames, left, odd = interrupted(simulation, folder, kind)
            same = checksum(folder) == sums[0]
            faults += left + odd + (not same)
            print(f"{kind[2]} x {kind[0].name}, {kind[1]} workers: {'the same' if same else 'ANOTHER'} manifest; ", end="")
            print(f"{left} processes left, {odd} other exit codes; frames on disk {frames}", flush=True)
    if faults:
        sys.exit(1)


if __name__ == "__main__":
    main()
