"""What this computer has."""

from __future__ import annotations

import json
from dataclasses import dataclass


@dataclass(frozen=True)
class Doctor:
    """Say what this computer has: versions, the OpenGL that renders, whether it is a GPU, and measured panoramas per second."""

    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from sim.doctor import describe, examine

        report = examine()
        print(json.dumps(report, indent=1) if self.json else describe(report))
