"""The command `pilsim generate`: make a dataset of one or more sequences."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import OmitArgPrefixes, Positional, arg

from sim.cli.options import (
    CameraSettings,
    DetectorSettings,
    Out,
    ScenarioSettings,
    SceneOptions,
    SensorSettings,
    Whole,
    camera_given,
    detector_given,
    given,
    print_place,
    unset,
)

if TYPE_CHECKING:
    from sim.datasets.presets import Preset


@dataclass(frozen=True)
class ImageFiles:
    """Image files beside JPEG."""

    png: bool = False
    """Write images without loss, as PNG in place of JPEG; files are three times as large."""
    range: bool = False
    """Write the range of every pixel, too, as 16-bit PNG in 1/256 m."""
    classes: bool = False
    """Write the semantic class of every pixel, too, as 8-bit PNG."""
    video: bool = False
    """Write an MP4 of every camera, too."""
    mesh: bool = True
    """Write the terrain as glTF, some MB a sequence."""


@dataclass(frozen=True)
class TwinFiles:
    """Source files of a twin."""

    annotations: Annotated[Path | None, unset("FILE", "those of SOURCE")] = None
    """The paths of the people: the CVML file of a PETS 2009 sequence, boxes in View_001."""
    calibration: Annotated[Path | None, unset("DIR", "that of SOURCE")] = None
    """The folder of View_001.xml and so on (Tsai)."""


@dataclass(frozen=True)
class Generate:
    """Generate a dataset: sequences of images with the full truth.

    The same command continues a dataset that was interrupted. The presets are:
      - pilsun            the paper's set: 333 frames, 4 robots, 10 people
      - s2l1, s2l2, s2l3  people and fixed cameras as in PETS 2009
      - room, room-rovers a dense room with four corner cameras, or two rovers
      - square            a square before seven cameras; people stand in groups
      - twin SOURCE       the people of a recording with truth on their real paths,
                          seen by the real cameras, and by rovers (--robots)

    Examples: pilsim generate pilsun --out D
              pilsim generate pilsun --world forest --count 20 --workers 2 --out D
              pilsim generate s2l2 --frames 100 --range --video --out D
              pilsim generate pilsun --config mine.toml --cluster tcp://10.0.0.1:8786 --count 500 --out /shared/D
              pilsim generate pilsun --rate 10 --imu bmi088@200 --wheels 50 --clock offset=±0.02,jitter=0.001 --out D
              pilsim generate twin my-cameras --cameras C1,C3 --frames 100 --out runs/twin
              pilsim generate twin --annotations S2.L1/annotations/PETS2009-S2L1.xml --calibration calibration --cameras 1,5,7 --out runs/twin
    """

    preset: Positional[Literal["pilsun", "s2l1", "s2l2", "s2l3", "room", "room-rovers", "square", "twin"]]
    """The kind of sequences."""
    out: Out
    """Folder of the dataset; complete sequences in it are kept. The folder of a twin must be new or empty."""
    source: Positional[Annotated[Path | None, unset("[SOURCE]", "for a twin alone")]] = None
    """Folder of the recording whose twin is made: PETS 2009, WILDTRACK, a recording or a sequence with truth, as `pilsim track` reads them."""
    count: int = 1
    """Number of sequences; sequence n has the seed + n, and so another world, other people and other paths."""
    seed: Whole = None
    """Seed of all random numbers."""
    frames: Whole = None
    """Number of frames of a sequence."""
    width: Whole = None
    """Width of a panorama, pixels; it is half as high. Images of fixed cameras are three quarters as wide."""
    fixed_cameras: Whole = None
    """Number of fixed cameras."""
    cameras: Annotated[str | None, unset("NAME,...", "all; 1 of PETS 2009")] = None
    """Names or numbers of the cameras of a twin, as in 1,5,7."""
    render: bool = True
    """Render images. With --no-render, boxes come from ray casting, robots have odometry and sightings of each other, and a recording is written."""
    workers: Annotated[int | None, unset("INT", "one a core")] = None
    """Number of processes that draw on this machine; the bytes are the same with any number."""
    scene: Annotated[OmitArgPrefixes[SceneOptions], arg(name="scene")] = SceneOptions()
    """These options set the world, its people and its robots."""
    files: Annotated[OmitArgPrefixes[ImageFiles], arg(name="file")] = ImageFiles()
    """These options choose what is written beside JPEG images and tables."""
    twin: Annotated[OmitArgPrefixes[TwinFiles], arg(name="twin")] = TwinFiles()
    """The two sources of a twin of PETS 2009, in place of SOURCE."""
    models: Annotated[OmitArgPrefixes[CameraSettings], arg(name="cameras")] = CameraSettings()
    """These options change the cameras."""
    sensors: Annotated[OmitArgPrefixes[SensorSettings], arg(name="robot sensors")] = SensorSettings()
    """These options add tables of the robots' own sensors: imu.csv, wheels.csv, stamps.csv."""
    scenario: Annotated[OmitArgPrefixes[ScenarioSettings], arg(name="expert scenario")] = ScenarioSettings()
    """These options change people, cameras and physics of the preset."""
    detector: Annotated[OmitArgPrefixes[DetectorSettings], arg(name="expert detector")] = DetectorSettings()
    """These options change the errors of the simulated detector of people."""
    config: Annotated[Path | None, unset("FILE", "none")] = None
    """A .toml or .json file of options, as frames = 100 or at_once = 8; the command line overrides it."""
    cluster: Annotated[str | None, unset("ADDRESS", "this machine alone")] = None
    """Address of a Dask scheduler, as tcp://10.0.0.1:8786, in place of this machine; its workers must see DIR under the same path.

    With fewer sequences than its threads, this machine simulates them and the cluster draws parts of their frames."""

    def run(self) -> None:
        if self.preset == "twin":
            self._twin()
            return
        from sim.datasets.generation import Plan, generate
        from sim.parallel.pool import usable_cores
        from tracker.sequence.writer import ImageForm

        if self.twin.annotations or self.twin.calibration:
            raise ValueError("--annotations and --calibration are for a twin: pilsim generate twin …")
        if self.source is not None:
            raise ValueError(f"{self.source}: the preset {self.preset} has no source; pilsim generate twin {self.source} makes its twin")
        if not self.render:
            self._cast()
            return
        form = ImageForm(**vars(self.files))
        plan = Plan(self.preset, self._preset(), self.out, self.count, form, usable_cores() if self.workers is None else self.workers, self.cluster)
        made = generate(plan)
        counted = f"{plan.count} sequence{'s' * (plan.count != 1)}, {made} new"
        print_place(self.out / plan.dataset.sequences[0])
        print(f"{self.out}: {counted} (README.md in it); `pilsim check {self.out}` verifies what is there")

    def _cast(self) -> None:
        from sim.datasets.generation import SequenceTask
        from sim.datasets.raycast_recording import write_raycast_recording
        from sim.recording.record import check_absent
        from tracker.sequence.writer import ImageForm

        if self.count != 1 or self.cluster or self.files != ImageFiles():
            raise ValueError("--no-render writes one recording without images, and takes no --count, --cluster or kinds of images")
        check_absent(self.out)
        write_raycast_recording(SequenceTask(self.out, self.preset, self._preset(), ImageForm()).simulated(), self.out)
        print(f"{self.out}: a recording without images (README.md in it); `pilsim track {self.out}` tracks it")

    def _given(self) -> dict[str, Any]:
        """Name → value of the options of a scenario on the command line."""
        own = {name: value for name in ("seed", "frames", "width") if (value := getattr(self, name)) is not None}
        return own | given(self.scene) | camera_given(self.models) | given(self.sensors) | given(self.scenario) | detector_given(self.detector)

    def _preset(self) -> Preset:
        """The preset with the settings of the file, overridden by those of the command line."""
        from sim.datasets.presets import preset_of, read_settings

        changes = self._given()
        if self.cameras is not None:
            raise ValueError(f"--cameras names cameras of a twin, and {self.preset} is none; --fixed-cameras is a number")
        if self.fixed_cameras is not None:
            changes["views"] = self.fixed_cameras
        if self.config is None:
            return preset_of(self.preset, changes)
        settings = read_settings(self.config)
        if isinstance(text := settings.get("detector_model"), str):
            from tracker.detector_models.model import chosen_model

            settings["detector_model"] = chosen_model(text)
        try:
            preset_of(self.preset, settings)
        except ValueError as error:
            raise ValueError(f"{self.config}: {error}") from None
        return preset_of(self.preset, settings | changes)

    def _twin(self) -> None:
        from sim.datasets.twin import Twin, generate_twin

        own = {"frames", "robots", "width", "seed", "detector_model", "difficulty"}
        changes = self._given()
        plain = self.count == 1 and not (self.cluster or self.config) and self.files == ImageFiles()
        if set(changes) - own or self.fixed_cameras is not None or not plain:
            named = ", ".join(f"--{name.replace('_', '-')}" for name in sorted(own | {"workers", "render"}))
            raise ValueError(f"a twin takes --cameras and {named}; the source sets the rest")
        file, calibration = self.twin.annotations, self.twin.calibration
        source = self.source or file
        if source is None or (self.source is None) == (file is None) or (file is None) != (calibration is None):
            raise ValueError("a twin needs SOURCE, or --annotations FILE and --calibration DIR")
        names = tuple(text.strip() for text in (self.cameras or "").split(",") if text.strip())
        for line in generate_twin(Twin(source, names, calibration=calibration, **changes), self.out, self.render, self.workers):
            print(line)
