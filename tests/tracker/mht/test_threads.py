"""The tracker gives the same people whatever the number of threads of the linear algebra."""

import io
import os
import subprocess
import sys

import numpy as np
import pytest

from tracker.geometry import Array

RUN = """
import sys
import numpy as np
from tests.benchmarks.room import room
from tracker.options import parameters_from
from tracker.pipeline import track

sequence = room(3, frames=40).sequence()
people = track(sequence.setup, sequence.ticks, parameters_from({"delay": 3}))
rows = [np.column_stack([np.full(len(e.target_id), e.index), e.target_id, e.position[:, :2]]) for e in people]
np.save(sys.stdout.buffer, np.concatenate(rows))
"""


def people(threads: int) -> Array:
    """Rows (n, 4) of frame, id and place m, by a process with such a number of threads."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    env = os.environ | dict.fromkeys(names, str(threads))
    done = subprocess.run([sys.executable, "-c", RUN], env=env, capture_output=True, check=True)
    return np.asarray(np.load(io.BytesIO(done.stdout)))


@pytest.mark.command
def test_ids_are_the_same_with_one_and_two_threads() -> None:
    one, two = people(1), people(2)
    assert len(one) > 300
    np.testing.assert_array_equal(one[:, :2], two[:, :2])
    np.testing.assert_allclose(one[:, 2:], two[:, 2:], rtol=0, atol=1e-3)
