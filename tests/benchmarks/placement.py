"""Speed of the placement environment compared with Gymnasium's Ant-v5 in the same process, and the memory of sixteen environments.

    python -m tests.benchmarks.placement

The table shows decisions and simulated seconds per second of process time of one core. Four robots and ten people in ruins take random actions;
observations and rewards are included.
"""

from __future__ import annotations

import resource
import time
from typing import Any

import gymnasium

import sim  # noqa: F401

KINDS = (("kinematic", "state", 1500), ("kinematic", "tracks", 30), ("kinematic", "pixels", 30), ("physics", "state", 60))
ENVS = 16


def speed(env: gymnasium.Env[Any, Any], steps: int) -> float:
    """Steps per second of process time, the best of three rounds after a warm-up."""
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(50)]
    for action in actions[:5]:
        env.step(action)
    best = 0.0
    for _ in range(3):
        start, done = time.process_time(), 0
        for k in range(steps // 3):
            _, _, over, cut, _ = env.step(actions[k % len(actions)])
            done += 1
            if over or cut:
                env.reset()
        best = max(best, done / (time.process_time() - start))
    return best


def peer() -> tuple[float, float] | None:
    """Steps and simulated seconds per second of Ant-v5. None where it cannot be made."""
    try:
        env = gymnasium.make("Ant-v5")
    except Exception as error:
        print(f"Ant-v5 cannot be made: {str(error).splitlines()[0]}")
        return None
    steps = speed(env, 3000)
    return steps, steps * float(env.unwrapped.dt)  # type: ignore[attr-defined]


def resident() -> float:
    """Peak memory of this process, MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    before = resident()
    envs = [gymnasium.make("pilsim/Placement-v0") for _ in range(ENVS)]
    for k, env in enumerate(envs):
        env.reset(seed=k % 10)
        env.step(env.action_space.sample())
    grown = resident() - before
    print(f"{ENVS} environments on one map need {grown:.0f} MiB beside the {before:.0f} MiB of the process\n")
    other = peer()
    print(f"{'drive':10s} {'observation':12s} {'steps/s':>9s} {'simulated s/s':>14s}")
    if other is not None:
        print(f"{'Ant-v5':23s} {other[0]:9.0f} {other[1]:14.1f}")
    for drive, observation, steps in KINDS:
        env = gymnasium.make("pilsim/Placement-v0", drive=drive, observation=observation)
        found = speed(env, steps)
        env.close()
        print(f"{drive:10s} {observation:12s} {found:9.1f} {0.5 * found:14.1f}", flush=True)


if __name__ == "__main__":
    main()
