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
    for name in slam.setup.starts:
        if slam.placed(name):
            pose = slam.pose(name)
            # The filter names its robots, the book of landmarks counts them: a robot is the one that stands where it stands.
            rotation, translation = joint.rotation[: joint.robots], joint.translation[: joint.robots]
            same = (translation == pose.translation).all(axis=1) & (rotation == pose.rotation).all(axis=(1, 2))
            if same.any():
                sighted[name] = book.identity[:n][book.when[:n, int(same.argmax())] == tick].astype(np.int64)
    return Chart(slam.identities().astype(np.int64), slam.landmarks(), sighted)
