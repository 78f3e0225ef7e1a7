"""What the filter's map is at a tick, and which of it each robot has just seen."""

from __future__ import annotations

import numpy as np

from tracker.measurements import Chart
from tracker.slam import Slam


def chart(slam: Slam, tick: int) -> Chart | None:
    """The map after the tick; None where no robot has a map."""
    joint, book = slam.state
    if not joint.robots:
        return None
    n, sighted = joint.count, {}
    for name, robot in slam.team.items():
        sighted[name] = book.identity[:n][book.when[:n, robot] == tick].astype(np.int64)
    return Chart(slam.identities().astype(np.int64), slam.landmarks(), sighted)
