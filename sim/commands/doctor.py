"""What this computer has."""

from __future__ import annotations

import json
from dataclasses import dataclass


@dataclass(frozen=True)
class Doctor:
    """Report what this computer has: versions, OpenGL, rendering speed.

    The report names the OpenGL renderer, says whether it is a GPU, and measures the
    panoramas that it renders per second.

    Example: pilsim doctor --json
    """

    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from sim.doctor import describe, examine

        report = examine()
        print(json.dumps(report, indent=1) if self.json else describe(report))
