"""Speed of the placement environment compared with Gymnasium's Ant-v5 in the same process, and the memory of sixteen environments.

    python -m tests.benchmarks.placement [profile|memory|batch]

The table shows decisions and simulated seconds per second of process time of one core. Four robots and ten people in ruins take random actions;
observations and rewards are included. `profile` shows where the time goes, and `memory` what the processes of make_vec take (Linux).
`batch` shows decisions a second of wall time of the batched environment on all cores, by its size, people, robots and world.
"""

from __future__ import annotations

import cProfile
import os
import pstats
import resource
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium

import sim  # noqa: F401

KINDS = (("kinematic", "state", 1500), ("kinematic", "tracks", 30), ("kinematic", "pixels", 30), ("physics", "state", 60))
ENVS = 16
VECTOR = 8


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


def profile() -> None:
    """Print the functions of pilsim that take most of each kind's time, with what they call."""
    for drive, observation, steps in KINDS:
        env = gymnasium.make("pilsim/Placement-v0", drive=drive, observation=observation)
        speed(env, 15)
        profiler = cProfile.Profile()
        profiler.runcall(speed, env, steps)
        print(f"{drive}, {observation}")
        pstats.Stats(profiler).sort_stats("cumulative").print_stats(r"(sim|tracker)/|mj_step", 30)
        env.close()


def batch() -> None:
    """Print decisions a second of all environments of make_vec("vector_entry_point"), beside Ant-v5 in as many environments."""
    usual = {"world": "ruins", "robots": 4, "people": 20}
    cases = [(envs, {}) for envs in (1, 8, 64)]
    cases += [(64, {"people": people}) for people in (10, 40, 74)] + [(64, {"robots": robots}) for robots in (2, 6)] + [(64, {"world": "campus"})]
    print(f"{'environments':>12s} {'world, robots, people':40s} {'decisions/s':>12s}")
    for count, options in cases:
        chosen = usual | options
        envs: Any = gymnasium.make_vec("pilsim/Placement-v0", num_envs=count, vectorization_mode="vector_entry_point", map_seed=0, **chosen)
        print(f"{count:12d} {' '.join(map(str, chosen.values())):40s} {batch_speed(envs, count):12.0f}", flush=True)
    print(f"{64:12d} {'Ant-v5':40s} {batch_speed(gymnasium.make_vec('Ant-v5', num_envs=64, vectorization_mode='async'), 64):12.0f}")


def batch_speed(envs: Any, count: int) -> float:
    """Steps of all environments per second of wall time, the best of three rounds after a warm-up."""
    envs.reset(seed=0)
    actions, best = [envs.action_space.sample() for _ in range(8)], 0.0
    for action in actions[:3]:
        envs.step(action)
    for _ in range(3):
        start, rounds = time.perf_counter(), max(8, 640 // count)
        for k in range(rounds):
            envs.step(actions[k % len(actions)])
        best = max(best, rounds * count / (time.perf_counter() - start))
    envs.close()
    return best


def memory() -> None:
    """Print the memory of the processes of an asynchronous make_vec, MiB a process, with a map of each process and with one map for all."""
    for options in ({}, {"map_seed": 0}):
        envs: Any = gymnasium.make_vec("pilsim/Placement-v0", num_envs=VECTOR, vectorization_mode="async", **options)
        envs.reset(seed=0)
        for _ in range(5):
            envs.step(envs.action_space.sample())
        each = [rollup(process.pid) for process in envs.processes]
        total = rollup(os.getpid())["Pss:"] + sum(one["Pss:"] for one in each)
        mean = {name: sum(one[name] for one in each) / VECTOR for name in each[0]}
        print(f"{VECTOR} processes, {options or 'a map each'}: {mean}; PSS of all {total:.0f}")
        envs.close()


def rollup(pid: int) -> dict[str, float]:
    """Resident, proportional (PSS), and private and written memory of a process, MiB."""
    rows = [line.split() for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()]
    return {row[0]: round(int(row[1]) / 1024) for row in rows if row[0] in ("Rss:", "Pss:", "Private_Dirty:")}


def main() -> None:
    if chosen := {"profile": profile, "memory": memory, "batch": batch}.get(sys.argv[-1]):
        chosen()
        return
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
