"""The command `pilsim info`: summarize a dataset."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from sim.cli.options import json_text


@dataclass(frozen=True)
class Info:
    """Summarize a dataset: frames, cameras, people, boxes, density, sizes.

    SOURCE is a dataset, one sequence, or any source of `pilsim track`. `pilsim check`
    verifies it. For a bag (ROS 1, ROS 2, MCAP), the topics are listed with types,
    numbers, rates and gaps.

    Examples: pilsim info D
              pilsim info D/pilsun-00000 --json
              pilsim info my-cameras
              pilsim info walk.bag
    """

    source: Annotated[Positional[Path], arg(metavar="SOURCE")]
    """The dataset, the sequence, the source or the bag."""
    json: bool = False
    """Print JSON alone; sizes are in MB."""

    def run(self) -> None:
        from tracker.formats.ros.bag_reader import bag_text, is_bag, summarize_bag
        from tracker.formats.summary import summarize, summary_text

        if is_bag(self.source):
            topics = summarize_bag(self.source)
            print(json_text(topics, indent=1) if self.json else bag_text(topics))
            return
        found = summarize(self.source)
        print(json_text(found, indent=1) if self.json else summary_text(found))
