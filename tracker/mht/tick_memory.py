"""The memory of the tracker: real intervals between the last ticks, and the number of ticks in each time window."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple, final

from tracker.types import Intervals


class Step(NamedTuple):
    """The time from one tick to the next.

    seconds: the real interval. revisit: Setup.revisit, s; revisits: the interval in this unit. elapsed: s since the first tick.
    scan: ticks of the N-scan window; window: ticks that leaves remember, the present one included.
    """

    seconds: float
    revisit: float
    elapsed: float
    scan: int
    window: int

    @property
    def revisits(self) -> float:
        """The interval in revisits: 1 where all cameras are synchronous."""
        return self.seconds / self.revisit


@final
class TickMemory:
    """The last ticks. Windows are durations, so that N-scan pruning and the smoother span the same time at any density of ticks."""

    def __init__(self, n_scan: float, delay: int, period: float, revisit: float) -> None:
        """n_scan: s. delay: least number of reported ticks that are remembered. period: usual s between reported ticks. revisit: as in Setup."""
        self.n_scan, self.delay, self.revisit = n_scan, delay, revisit
        self._intervals, self._elapsed = Intervals(period), -period
        # The memory starts with virtual ticks at the usual period.
        count = max(round(n_scan / period), delay) + 2
        self._seconds: deque[float] = deque([period] * count)
        self._reported: deque[bool] = deque([True] * count)

    def step(self, time: float, reported: bool) -> Step:
        """The step to the tick at `time` s."""
        seconds = self._intervals.step(time)
        self._elapsed += seconds
        self._seconds.append(seconds)
        self._reported.append(reported)
        scan = self._nearest(self.n_scan)
        window = max(scan, self._frames_back(self.delay)) + 1
        while len(self._seconds) > 2 * window + 2:
            self._seconds.popleft()
            self._reported.popleft()
        return Step(seconds, self.revisit, self._elapsed, scan, window)

    def _nearest(self, seconds: float) -> int:
        """Number of ticks since the tick whose age is nearest to `seconds`."""
        age = 0.0
        for k, step in enumerate(reversed(self._seconds)):
            if age + step / 2 >= seconds:
                return k
            age += step
        return len(self._seconds)

    def _frames_back(self, count: int) -> int:
        """Number of ticks since the reported tick that is `count` reported ticks before the last reported one."""
        for k, reported in enumerate(reversed(self._reported)):
            count -= reported
            if count < 0:
                return k
        return len(self._reported)
