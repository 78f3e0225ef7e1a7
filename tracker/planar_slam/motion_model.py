"""The sensor model of robots in the plane that are told a speed and a turn, and see barcodes: what they did, and how sure that is.

Commands take effect late: after a dead time and a first-order lag. The wheels of a turning robot lose way in proportion to the turn. Sightings are
stamped late, their errors grow with the range and hang on for a while. The defaults were found on set 1 of UTIAS alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tracker.geometry import Array

FINE = 0.01  # s: commands are laid on this grid before they are delayed


@dataclass(frozen=True)
class Sensors:
    """speed_delay, turn_delay, lag s; speed_scale, turn_scale: done over commanded; turn_costs m of way lost a rad turned. hold s: a command
    that is not renewed for so long is over.

    Variances grow by way_noise² m² a s while there is a command, by way_slip² a m, across² m² a m, turn_noise² rad² a s, turn_slip² a rad.
    camera_delay s; range_sigma m at least, range_share of the range; bearing_sigma rad, and place_sigma m across the line of sight; memory s over
    which errors of sightings of the same subject hang together. robot_range m: what ranges of robots are too long; robot_sigma m: their own error.

    The correction factor's deviations at the start: offsets (rad, m, share), scales of the odometry (of speed, of turn); walk: what the five gain
    in the square root of a second.
    """

    speed_delay: float = 0.12
    turn_delay: float = 0.11
    lag: float = 0.17
    speed_scale: float = 1.05
    turn_scale: float = 0.92
    turn_costs: float = 0.09
    hold: float = 2.0
    way_noise: float = 0.007
    way_slip: float = 0.03
    across: float = 0.008
    turn_noise: float = 0.0125
    turn_slip: float = 0.155
    camera_delay: float = 0.038
    range_sigma: float = 0.075
    range_share: float = 0.145
    bearing_sigma: float = 0.0125
    place_sigma: float = 0.03
    memory: float = 0.45
    robot_range: float = 0.04
    robot_sigma: float = 0.035
    offsets: tuple[float, float, float] = (0.015, 0.045, 0.03)
    scales: tuple[float, float] = (0.045, 0.075)
    walk: tuple[float, float, float, float, float] = (3e-4, 7.5e-4, 3e-4, 1.5e-4, 1.5e-4)

    def __post_init__(self) -> None:
        for name in ("lag", "hold", "range_sigma", "bearing_sigma"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}, needs more than 0")


def integrate(odometry: Array, sensors: Sensors, times: Array) -> Array:
    """Commands (n, 3) of time s, m/s, rad/s → at times (m,) s since the first: (m, 3) way m, turn rad, and turn without sign, rad."""
    begin = odometry[0, 0]
    fine = np.arange(begin, max(odometry[-1, 0], times[-1]) + 1, FINE)
    last = np.searchsorted(odometry[:, 0], fine, side="right") - 1
    fresh = fine - odometry[last, 0] <= sensors.hold
    rates = np.where(fresh[:, None], odometry[last, 1:], 0.0)
    keep = np.exp(-FINE / sensors.lag)
    rates = lfilter([1 - keep], [1, -keep], rates, axis=0)
    speed, turn = sensors.speed_scale * rates[:, 0], sensors.turn_scale * rates[:, 1]
    speed = np.sign(speed) * np.maximum(np.abs(speed) - sensors.turn_costs * np.abs(turn), 0)
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(np.stack([speed, turn, np.abs(turn)], axis=1) * FINE, axis=0)])
    at = np.concatenate([fine, fine[-1:] + FINE])
    delays = (sensors.speed_delay, sensors.turn_delay, sensors.turn_delay)
    return np.stack([np.interp(times - delay, at, column) for delay, column in zip(delays, sums.T, strict=True)], axis=1)


def step_noise(steps: Array, seconds: Array, sensors: Sensors) -> Array:
    """Steps (m, 3) of way m, turn rad, turn without sign rad, that took seconds (m,) → variances (m, 8), as planar.predict takes them."""
    moving = np.abs(steps[:, 0]) + steps[:, 2] > 1e-9
    out = np.zeros((len(steps), 8))
    out[:, 0] = moving * seconds * sensors.way_noise**2 + sensors.way_slip**2 * np.abs(steps[:, 0])
    out[:, 1] = sensors.across**2 * np.abs(steps[:, 0])
    out[:, 2] = moving * seconds * sensors.turn_noise**2 + sensors.turn_slip**2 * steps[:, 2]
    out[:, 3:] = seconds[:, None] * np.square(sensors.walk)
    return out


def sighting_sigma(seen: Array, subject: NDArray[np.int64], robots: NDArray[np.bool_], sensors: Sensors) -> Array:
    """Sightings (m, 3) of time s, range m, bearing rad, in order → deviations (m, 2) m, rad; robots (m,): whether a robot was seen.

    Errors that hang together, ρ = exp(−Δt/memory) from one sighting of a subject to the next, tell less than independent ones: the
    information of a long row of such sightings is (1 − ρ)/(1 + ρ) of that of as many independent ones, so the variance is divided by this.
    """
    since = np.full(len(seen), np.inf)
    for s in np.unique(subject):
        k = np.flatnonzero(subject == s)
        since[k[1:]] = np.diff(seen[k, 0])
    rho = np.minimum(np.exp(-since / sensors.memory), 0.98) if sensors.memory > 0 else np.zeros(len(seen))
    reach = np.maximum(sensors.range_sigma, sensors.range_share * seen[:, 1])
    reach = np.hypot(reach, np.where(robots, sensors.robot_sigma, 0.0))
    across = np.hypot(sensors.bearing_sigma, np.where(robots, sensors.robot_sigma, sensors.place_sigma) / seen[:, 1])
    return np.stack([reach, across], axis=1) * np.sqrt((1 + rho) / (1 - rho))[:, None]
