"""The command `pilsim check`: verify a dataset."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

SHOWN = 100
"""Largest number of faults that are printed. All faults are counted."""


@dataclass(frozen=True)
class Check:
    """Verify a dataset: checksums, tables, and truth against images.

    DIR is a dataset or one sequence. Each fault is a line, FILE: what is wrong.
    The command checks checksums and sizes, and that no frame is missing. It checks
    that every image decodes to the size of its camera, and that boxes match the
    instance masks to the pixel. It checks that key points project from the joints,
    and that values are within their bounds. The exit code is 0 without a fault,
    else 2.

    Examples: pilsim check D
              pilsim check D/pilsun-00000 --json
    """

    source: Annotated[Positional[Path], arg(metavar="DIR")]
    """The dataset or the sequence."""
    json: bool = False
    """Print JSON alone: {"faults": [{"file": …, "reason": …}, …], "count": …}."""

    def run(self) -> None:
        from tracker.datasets.validation import validate
        from tracker.io.progress import print_line, progress_bar
        from tracker.sequence.dataset import sequences

        def shown(items: Iterable[Any], name: str, total: int) -> Iterable[Any]:
            return progress_bar(items, desc=name, total=total, leave=False, disable=self.json)

        faults, count = [], 0
        for fault in validate(self.source, shown):
            count += 1
            if count <= SHOWN:
                faults.append({"file": str(fault.file), "reason": fault.reason})
                if not self.json:
                    print_line(str(fault))
        if self.json:
            print(json.dumps({"faults": faults, "count": count}, indent=1))
        if count:
            raise ValueError(f"{self.source}: {count} fault{'s' * (count > 1)}{f', the first {SHOWN} are named' * (count > SHOWN)}")
        if not self.json:
            count = len(sequences(self.source))
            print(f"{self.source}: {count} sequence{'s' * (count != 1)}, no fault")
