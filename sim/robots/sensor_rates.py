"""Sampling rates of the sensors on a rover: a sample is made after every n-th step of the physics, n a whole number."""

from __future__ import annotations

IMU_RATES = (100.0, 400.0)
"""Lowest and highest sampling rate of an IMU, Hz."""
WHEEL_RATES = (10.0, 400.0)
"""Lowest and highest sampling rate of the wheel encoders, Hz."""
LISTED = 10
"""Largest number of rates that an error message lists."""
_SAME = 1e-4
"""Relative difference below which a rate is meant: users write 28.2857 for 198/7."""


def possible_rates(physics: float, bounds: tuple[float, float]) -> list[float]:
    """Rates, Hz, within bounds that a whole number of steps of `physics` steps/s gives, the highest first."""
    low, high = bounds
    rates = [physics / n for n in range(1, int(physics / low) + 2)]
    return [rate for rate in rates if low * (1 - _SAME) <= rate <= high * (1 + _SAME)]


def steps_a_sample(name: str, rate: float | None, physics: float, bounds: tuple[float, float]) -> int:
    """Number of physics steps a sample. rate: Hz, or None for the highest possible. physics: steps/s. name: of the option, for messages.

    Raises ValueError, which names the possible rates, for a rate out of bounds or one that no whole number of steps gives.
    """
    low, high = bounds
    if rate is not None and not low <= rate <= high:
        raise ValueError(f"{name} is {rate:g} Hz, needs {low:g} to {high:g} Hz")
    possible = possible_rates(physics, bounds)
    if not possible:
        raise ValueError(f"{name} needs {low:g} to {high:g} Hz, but the physics has {physics:g} steps/s; choose a smaller timestep")
    for each in possible:
        if rate is None or abs(each - rate) <= _SAME * rate:
            return round(physics / each)
    listed = ", ".join(f"{each:g}" for each in possible[:LISTED]) + (", …" if len(possible) > LISTED else "")
    raise ValueError(f"{name} is {rate:g} Hz, needs a whole number of physics steps: {listed} Hz (another timestep or frame rate gives others)")
