"""Order of rows by time: sorted, merged, counted, and large steps back."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tracker.io.time_order import LARGEST_STEP_BACK, first_large_step_back, time_order

ROWS = st.lists(st.tuples(st.integers(0, 8), st.integers(0, 2)), max_size=12)


@given(ROWS)
def test_rows_are_in_order_once_each(rows: list[tuple[int, int]]) -> None:
    """Each row occurs once, times ascend, and rows of one time stay in the order of their last occurrence."""
    values = np.array(rows, dtype=np.float64).reshape(-1, 2)
    order = time_order(values)
    kept = [tuple(row) for row in values[order.rows].astype(int).tolist()]
    last = sorted(set(rows), key=lambda row: (row[0], len(rows) - rows[::-1].index(row)))
    assert kept == last
    assert order.repeated == len(rows) - len(set(rows))
    assert order.late == sum(any(before[0] > row[0] for before in rows[:k]) for k, row in enumerate(rows))


@given(ROWS)
def test_the_first_large_step_back(rows: list[tuple[int, int]]) -> None:
    times = np.array([row[0] for row in rows]) / 4
    wanted = next((k for k in range(len(times)) if times[:k].max(initial=-np.inf) - times[k] >= LARGEST_STEP_BACK), None)
    found = first_large_step_back(times)
    assert (found and found[0]) == wanted
    if found:
        assert times[found[1]] == times[: found[0]].max()
