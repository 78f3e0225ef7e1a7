"""One sequence drawn on a Dask cluster, by parts."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from sim.recording.drawing import AHEAD, LONGEST, PARTS, SHORTEST, check_versions, part_length
from sim.recording.frame_journal import NAME
from sim.recording.record import versions
from tests.sim.recording.test_resumable import checksum

FRAMES = 12 * SHORTEST


def test_parts_are_even_and_within_bounds() -> None:
    assert part_length(1, 1) == part_length(333, 64) == SHORTEST
    assert part_length(100_000, 2) == LONGEST
    for missing, threads in ((333, 2), (333, 4), (2000, 16)):
        length = part_length(missing, threads)
        assert SHORTEST < length <= LONGEST
        assert PARTS * threads - 1 <= -(-missing // length) <= max(PARTS * threads, -(-missing // LONGEST))
    assert AHEAD > 1


@pytest.mark.soak
def test_a_cluster_draws_one_sequence_though_a_worker_and_the_command_are_killed(tmp_path: Path, cluster: Any) -> None:
    words = ["generate", "pilsun", "--frames", str(FRAMES), "--width", "128", "--robots", "1", "--people", "3", "--fixed-cameras", "0", "--no-mesh"]
    command = [sys.executable, "-m", "pilsim", *words]
    here = subprocess.Popen([*command, "--workers", "1", "--out", tmp_path / "here"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    folder = tmp_path / "there"
    journal = folder / ".pilsun-00000.partial" / NAME

    def wait_for(drawn: int) -> None:
        while not journal.exists() or len(journal.read_bytes().splitlines()) <= drawn:
            assert run.poll() is None
            time.sleep(0.01)

    assert here.wait() == 0
    there = [*command, "--cluster", cluster.scheduler_address, "--out", str(folder)]
    run = subprocess.Popen(there, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_for(1)
    os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
    wait_for(SHORTEST + 1)
    run.kill()
    run.wait()
    assert SHORTEST < len(journal.read_bytes().splitlines()) - 1 < FRAMES
    again = subprocess.run(there, capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stderr
    assert checksum(folder / "pilsun-00000") == checksum(tmp_path / "here" / "pilsun-00000")
    assert not list(folder.glob(".*partial"))


def test_a_worker_with_other_versions_is_refused() -> None:
    check_versions(versions())
    with pytest.raises(ValueError, match=r"^numpy is .* in a worker of the cluster, needs 0\.1 as here$"):
        check_versions(versions() | {"numpy": "0.1"})
