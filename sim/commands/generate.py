"""From a scenario to sequences."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional

from sim.commands.options import Out, numbers, unset
from sim.commands.settings import Settings

if TYPE_CHECKING:
    from sim.presets import Preset


@dataclass(frozen=True)
class Generate:
    """Generate a dataset: sequences of panoramas and of fixed cameras' images, with the truth of everything. It goes on where it was cut off.

    PRESET is pilsun (as the paper's set: 333 frames, 4 robots, 10 people, indoors), s2l1, s2l2 or s2l3 (crowds and cameras as in PETS 2009), each
    in any world; or twin: the people of a PETS 2009 annotation on their real paths, before the real cameras and before rovers.

    Examples: pilsim generate pilsun --out D
              pilsim generate pilsun --world forest --count 20 --workers 2 --out D
              pilsim generate s2l2 --frames 100 --range --video --out D
              pilsim generate pilsun --config mine.toml --cluster tcp://10.0.0.1:8786 --count 500 --out /shared/D
              pilsim generate twin --annotations S2.L1/annotations/PETS2009-S2L1.xml --calibration calibration --views 1,5,7 --out runs/twin
    """

    preset: Positional[Literal["pilsun", "s2l1", "s2l2", "s2l3", "twin"]]
    """What kind of sequences."""
    out: Out
    """Where the dataset goes; what is whole in it is kept. A twin is one sequence, and must not be there yet."""
    settings: OmitArgPrefixes[Settings] = Settings()
    views: Annotated[str | None, unset("STR", "the preset's; 1 of a twin")] = None
    """How many fixed cameras look on; or, for a twin, the numbers of the PETS cameras, as in 1,5,7."""
    count: int = 1
    """How many sequences; the n-th has the seed + n, and with it another place, people and ways."""
    workers: int = 1
    """Processes on this machine; the bytes are the same with any number."""
    cluster: Annotated[str | None, unset("ADDRESS", "this machine alone")] = None
    """A Dask scheduler, as in tcp://10.0.0.1:8786, to use instead; its workers must see DIR under the same path."""
    config: Annotated[Path | None, unset("FILE", "none")] = None
    """A .toml or .json file of settings, as frames = 100 or at_once = 8; options given beside it win."""
    png: bool = False
    """Images without loss, as PNG in place of JPEG; three times as large."""
    range: bool = False
    """The range of every pixel too, as 16-bit PNG in 1/256 m."""
    classes: bool = False
    """The semantic class of every pixel too, as 8-bit PNG."""
    video: bool = False
    """An MP4 of every camera too."""
    mesh: bool = True
    """The terrain as glTF, some MB a sequence."""
    annotations: Annotated[Path | None, unset("FILE", "needed for a twin")] = None
    """Of a twin, who walked where: the CVML file of any PETS 2009 sequence, boxes in View_001."""
    calibration: Annotated[Path | None, unset("DIR", "needed for a twin")] = None
    """Of a twin, the folder of View_001.xml and so on (Tsai)."""

    def run(self) -> None:
        if self.preset == "twin":
            self._twin()
            return
        from sim.generation import Plan, generate
        from tracker.recording import Form

        if self.annotations or self.calibration:
            raise ValueError("--annotations and --calibration are for a twin: pilsim generate twin …")
        form = Form(self.png, self.range, self.classes, self.video, self.mesh)
        plan = Plan(self.preset, self._preset(), self.out, self.count, form, self.workers, self.cluster)
        made = generate(plan)
        counted = f"{plan.count} sequence{'s' * (plan.count != 1)}, {made} new"
        print(f"{self.out}: {counted} (README.md in it); `pilsim check {self.out}` verifies what is there")

    def _preset(self) -> Preset:
        """The preset with the settings of the file, and over them those of the command line."""
        from sim.presets import preset_of, read_settings

        changes = self.settings.given()
        if self.views is not None:
            if not self.views.isdecimal():
                raise ValueError(f"--views is {self.views!r}, needs a number of cameras")
            changes["views"] = int(self.views)
        if self.config is None:
            return preset_of(self.preset, changes)
        settings = read_settings(self.config)
        try:
            preset_of(self.preset, settings)
        except ValueError as error:
            raise ValueError(f"{self.config}: {error}") from None
        return preset_of(self.preset, settings | changes)

    def _twin(self) -> None:
        from functools import partial

        from tqdm import tqdm

        from sim.side_by_side import side_by_side
        from sim.twin import Twin, generate, likeness

        if self.annotations is None or self.calibration is None:
            raise ValueError("a twin needs --annotations FILE and --calibration DIR")
        own = {"frames", "robots", "width", "seed"}
        given = self.settings.given()
        forms = (self.png, self.range, self.classes, self.video, not self.mesh)
        ours = self.count == self.workers == 1 and not (self.cluster or self.config or any(forms))
        if set(given) - own or not ours:
            raise ValueError(f"a twin takes --views and {', '.join(f'--{name}' for name in sorted(own))}, the rest is of its annotation")
        views = tuple(numbers(self.views or "1"))
        twin = dataclasses.replace(Twin(self.annotations, self.calibration, views), **given)
        generate(twin, self.out, progress=partial(tqdm, desc="frames", unit="frame"))
        print(f"{self.out}: a sequence (README.md in it); `pilsim track {self.out}` tracks it")
        if 1 in views:
            side_by_side(twin, self.out)
            alike = sorted(likeness(twin, self.out).tolist())
            median = alike[len(alike) // 2]
            print(f"overlap of {len(alike)} annotated boxes with the twin's in View_001: median IoU {median:.3f} (twin.png shows a frame)")
