"""Clock offsets of cameras: estimated from moving people or given, and applied as clocks of the recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import t as student

from tracker.io.text_files import named_values, parse_number
from tracker.recordings.calibration_feet import CalibrationCase
from tracker.recordings.calibration_timing import LEAST_DELAY, QUARTERS, delays_among
from tracker.recordings.clocks import CameraClock
from tracker.recordings.recording import Recording

AUTO = "auto"
SIGNIFICANCE = 0.01
"""Probability of a false offset in a synchronized recording, if errors in the quarters are independent and normal."""
_GRAMMAR = "auto, or CAMERA=SECONDS,... (later is positive)"


def parsed_offsets(text: str, cameras: list[str]) -> dict[str, float]:
    """Camera → s by which its pictures are later than its clock says. Raises ValueError for an invalid text and an unknown camera."""
    given = named_values(text, cameras, "--offsets has", f"{_GRAMMAR}, with CAMERA one of {', '.join(cameras)}")
    return {name: parse_number(number, f"--offsets has {name}, which") for name, number in given.items()}


def estimated_offsets(recording: Recording) -> dict[str, float]:
    """Fixed camera → s by which its pictures are later than its clock says, for cameras that clearly differ from the others.

    Feet of one person in two cameras are compared, without truth (calibration_timing.py). A common offset is not observable, so the median is set to
    0. Offsets that are not significant are left at 0. Standard errors are those of the mean of four quarters, so Student's distribution has three
    degrees of freedom. All cameras are tested at once (Bonferroni). All offsets are left at 0 if none exceeds LEAST_DELAY, because errors of feet
    imitate shorter offsets.
    """
    delays, rate = delays_among(CalibrationCase.of(recording)), recording.rate
    if len(delays) < 2:
        return {}
    # A delay is against the mean of the others. A frame that is numbered late shows an earlier time.
    share = (len(delays) - 1) / len(delays)
    found = {name: -share * delay.frames / rate for name, delay in delays.items()}
    middle = float(np.median(list(found.values())))
    errors = student.isf(SIGNIFICANCE / (2 * len(found)), QUARTERS - 1)
    sure = {name: found[name] - middle for name in found if abs(found[name] - middle) > errors * share * delays[name].spread / rate}
    return {name: round(seconds, 4) for name, seconds in sure.items()} if max(map(abs, sure.values()), default=0.0) > LEAST_DELAY else {}


def with_offsets(recording: Recording, offsets: dict[str, float]) -> Recording:
    """The recording with clocks that are later by `offsets`: camera → s."""
    moved = {name: recording.clocks.get(name, CameraClock()).later(seconds) for name, seconds in offsets.items()}
    clocks = {**recording.clocks, **moved}
    changed = replace(recording, frames=0, clocks={name: clocks[name] for name in recording.cameras if name in clocks})
    return replace(changed, frames=max(recording.frames, changed.frames))
