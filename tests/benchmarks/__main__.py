"""Run benchmarks by name, or all that take minutes: `python -m tests.benchmarks [NAME ...]`. Each prints a table.

A benchmark without its peer installed says so. Those of LONG take long, and run only by name.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys

from sim.rendering.gl_context import GLUnavailable

NAMES = (
    "crowd", "simulation", "panorama", "workers", "writing", "clique", "slam", "space", "throughput", "utias", "tracker", "crowds", "placement",
    "placement_reward", "detector_models", "prediction", "detectors", "growth", "interruption", "effects", "calibration",
    "own_places", "own_robots",
)  # fmt: skip
LONG = ("space", "crowds", "placement_reward", "growth", "interruption", "calibration", "own_places", "own_robots")


def main() -> int:
    chosen = sys.argv[1:] or [name for name in NAMES if name not in LONG and importlib.util.find_spec(f"tests.benchmarks.{name}")]
    unknown = [name for name in chosen if name not in NAMES]
    if unknown:
        print(f"error: benchmark is {', '.join(unknown)}, needs to be among {', '.join(NAMES)}", file=sys.stderr)
        return 2
    for name in chosen:
        print(f"\n== {name}\n", flush=True)
        try:
            importlib.import_module(f"tests.benchmarks.{name}").main()
        except GLUnavailable as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
