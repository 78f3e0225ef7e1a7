"""Odometry from velocity commands and the noise of motion and measurements, for the UTIAS robots.

Commands act after a dead time and a first-order lag. Wheels lose distance in proportion to the turn. Measurements have late time stamps, and
correlated errors that grow with range. The defaults are fitted to UTIAS set 1 alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tracker.geometry import Array
from tracker.planar_slam.utias_files import LONG_GAP

FINE = 0.01  # s: commands are sampled on this grid before they are delayed


@dataclass(frozen=True)
class Sensors:
    """Parameters of odometry and camera.

    speed_delay, turn_delay, lag s; speed_scale, turn_scale: actual over commanded. turn_loss: m of distance lost per rad turned.
    command_timeout s: a command that is not renewed ends after it.

    Variances grow by distance_noise² m²/s while a command is active, distance_slip² m²/m and lateral_noise² m²/m. The heading's grow by
    turn_noise² rad²/s while a command is active, and turn_slip² rad²/rad.

    camera_delay s. range_sigma m at least, range_share of the range. bearing_sigma rad, and position_sigma m across the line of sight.
    correlation_time s of errors of measurements of the same subject. robot_range m: bias of ranges to robots; robot_sigma m: their additional error.

    Initial standard deviations of the correction factor: offsets (rad, m, share), and of the odometry's scales (speed, turn). random_walk: growth
    of these five standard deviations per √s.
    """

    speed_delay: float = 0.12
    turn_delay: float = 0.11
    lag: float = 0.17
    speed_scale: float = 1.05
    turn_scale: float = 0.92
    turn_loss: float = 0.09
    command_timeout: float = 2.0
    distance_noise: float = 0.007
    distance_slip: float = 0.03
    lateral_noise: float = 0.008
    turn_noise: float = 0.0125
    turn_slip: float = 0.155
    camera_delay: float = 0.038
    range_sigma: float = 0.075
    range_share: float = 0.145
    bearing_sigma: float = 0.0125
    position_sigma: float = 0.03
    correlation_time: float = 0.45
    robot_range: float = 0.04
    robot_sigma: float = 0.035
    offsets: tuple[float, float, float] = (0.015, 0.045, 0.03)
    scales: tuple[float, float] = (0.045, 0.075)
    random_walk: tuple[float, float, float, float, float] = (3e-4, 7.5e-4, 3e-4, 1.5e-4, 1.5e-4)


def integrate(odometry: Array, sensors: Sensors, times: Array) -> Array:
    """Commands (n, 3) of time s, m/s, rad/s → motion since the first one at times (m,) s, which ascend.

    Returns (m, 3): distance m, turn rad, and the sum of absolute turns, rad. Memory does not grow with gaps of more than LONG_GAP, in which a
    robot stands still.
    """
    # Long after the last command of a piece the robot is at rest. 40 time constants of the lag leave less than the rounding of a float.
    rest = sensors.command_timeout + 40 * sensors.lag
    pieces = np.split(odometry, np.flatnonzero(np.diff(odometry[:, 0]) > max(LONG_GAP, rest)) + 1)
    moved = np.zeros((len(times), 3))
    for piece in pieces:
        if piece[0, 0] <= times[-1]:
            first = int(np.searchsorted(times, piece[0, 0]))
            moved[first:] += _integrate_piece(piece, sensors, times[first:], float(min(piece[-1, 0] + rest, times[-1])))
    return moved


def _integrate_piece(odometry: Array, sensors: Sensors, times: Array, end: float) -> Array:
    """As `integrate`, for commands without long gaps, on a grid of times until `end`."""
    begin = odometry[0, 0]
    fine = np.arange(begin, end + 1, FINE)
    last = np.searchsorted(odometry[:, 0], fine, side="right") - 1
    recent = fine - odometry[last, 0] <= sensors.command_timeout
    rates = np.where(recent[:, None], odometry[last, 1:], 0.0)
    keep = np.exp(-FINE / sensors.lag)
    rates = lfilter([1 - keep], [1, -keep], rates, axis=0)
    speed, turn = sensors.speed_scale * rates[:, 0], sensors.turn_scale * rates[:, 1]
    speed = np.sign(speed) * np.maximum(np.abs(speed) - sensors.turn_loss * np.abs(turn), 0)
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(np.stack([speed, turn, np.abs(turn)], axis=1) * FINE, axis=0)])
    at = np.concatenate([fine, fine[-1:] + FINE])
    delays = (sensors.speed_delay, sensors.turn_delay, sensors.turn_delay)
    return np.stack([np.interp(times - delay, at, column) for delay, column in zip(delays, sums.T, strict=True)], axis=1)


def step_noise(steps: Array, seconds: Array, sensors: Sensors) -> Array:
    """Steps (m, 3) of distance m, turn rad and absolute turn rad, of durations seconds (m,) → variances (m, 8) as in filter.predict."""
    moving = np.abs(steps[:, 0]) + steps[:, 2] > 1e-9
    out = np.zeros((len(steps), 8))
    out[:, 0] = moving * seconds * sensors.distance_noise**2 + sensors.distance_slip**2 * np.abs(steps[:, 0])
    out[:, 1] = sensors.lateral_noise**2 * np.abs(steps[:, 0])
    out[:, 2] = moving * seconds * sensors.turn_noise**2 + sensors.turn_slip**2 * steps[:, 2]
    out[:, 3:] = seconds[:, None] * np.square(sensors.random_walk)
    return out


def sighting_sigma(seen: Array, subject: NDArray[np.int64], robots: NDArray[np.bool_], sensors: Sensors) -> Array:
    """Measurements (m, 3) of time s, range m, bearing rad, in order → standard deviations (m, 2) m, rad; robots (m,): whether of a robot.

    Errors of a subject have the correlation ρ = exp(−Δt/correlation_time) from one measurement to the next. A long series of them has
    (1 − ρ)/(1 + ρ) of the information of as many independent ones. So the variance is divided by this.
    """
    since = np.full(len(seen), np.inf)
    for s in np.unique(subject):
        k = np.flatnonzero(subject == s)
        since[k[1:]] = np.diff(seen[k, 0])
    rho = np.minimum(np.exp(-since / sensors.correlation_time), 0.98) if sensors.correlation_time > 0 else np.zeros(len(seen))
    reach = np.maximum(sensors.range_sigma, sensors.range_share * seen[:, 1])
    reach = np.hypot(reach, np.where(robots, sensors.robot_sigma, 0.0))
    across = np.hypot(sensors.bearing_sigma, np.where(robots, sensors.robot_sigma, sensors.position_sigma) / seen[:, 1])
    return np.stack([reach, across], axis=1) * np.sqrt((1 + rho) / (1 - rho))[:, None]
