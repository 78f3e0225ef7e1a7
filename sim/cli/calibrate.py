"""The command `pilsim calibrate`: calibrate cameras by the people who walk before them."""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.conf import OmitArgPrefixes, Positional, arg

from sim.cli.options import Out, command_line, json_text, unset
from sim.cli.track import SourceChoice
from tracker.options import Ending

if TYPE_CHECKING:
    from tracker.calibration import Calibration, Known
    from tracker.geometry import Array
    from tracker.recordings import Recording, RecordingCamera

UNKNOWN = 3
"""The exit code where the data do not determine all parameters, and a guess was written."""
MOST_CLOCK = 300.0
"""Largest value of --clock, s."""
FAR_CLOCK = 30.0
"""Value of --clock that is proposed where the data do not determine all parameters, s."""
METRES = "a number of metres"
"""The value that options of lengths need, for error messages."""


@dataclass(frozen=True)
class Calibrate:
    """Calibrate cameras by the people who walk before them.

    SOURCE is a recording of fixed cameras with boxes of people, on flat ground. A camera
    with unknown calibration has only its width and height in recording.json. The
    command finds its focal length, pitch, roll, height and place, and the offset of
    its clock. Cameras that have R and t keep them, and define the world. If none has
    them, the first camera is at x = y = 0 and looks along x.

    It needs people who walk about. Feet and heads determine each camera. Paths that
    two cameras see determine their relative pose. Scale comes from the stature of
    people (1.72 m in the mean), from --height or from --distance.

    The result is a recording with calibrated.json: parameters, deviations, covariance.
    Where the data do not determine a parameter, a line names it, the exit code is 3,
    and the best guess is in DIR.guess.

    Examples: pilsim calibrate my-cameras --out runs/calibrated
              pilsim calibrate my-cameras --height C1=2.85 --out runs/calibrated
              pilsim calibrate WILDTRACK --from nothing --frames 0:200 --out runs/w
              pilsim calibrate my-cameras --from current --out runs/refined
    """

    source: Annotated[Positional[Path], arg(metavar="SOURCE")]
    """The recording."""
    out: Out
    """Folder of the new recording; it must not exist yet."""
    from_: Annotated[Literal["given", "nothing", "intrinsics", "current"], arg(name="from")] = "given"
    """Parameters that are kept: all given ones, image sizes only (nothing), K too (intrinsics), or all as a start, to find changes (current)."""
    height: tyro.conf.UseAppendAction[Annotated[tuple[str, ...], arg(metavar="NAME=M", help_behavior_hint="(default: none; repeatable)")]] = ()
    """Height of a camera above the ground, m."""
    distance: tyro.conf.UseAppendAction[Annotated[tuple[str, ...], arg(metavar="NAME,NAME=M", help_behavior_hint="(default: none; repeatable)")]] = ()
    """Distance of two cameras, m."""
    pixel_aspect: tyro.conf.UseAppendAction[
        Annotated[tuple[str, ...], arg(metavar="NAME=RATIO", help_behavior_hint="(default: by size; repeatable)")]
    ] = ()
    """Width over height of a camera's pixels. By default pixels are square, but 720 x 576 px and other sizes of PAL and NTSC count as 4:3."""
    stature: Annotated[str, arg(metavar="M|none")] = "1.72"
    """Mean stature of the people, m; none where it is not known."""
    clock: Annotated[float, arg(metavar="S")] = 5.0
    """Largest offset between the clocks of two cameras, s; 0 where they are synchronous. The time that the search takes grows with it."""
    principal: bool = False
    """Estimate the principal point, too."""
    k1: bool = False
    """Estimate the radial distortion k1, too."""
    picture: Annotated[Path | None, Ending(".png"), unset("FILE.png", "none")] = None
    """Draw the plan with the paths of people, and the view of each camera with ground grid and horizon."""
    page: Annotated[Path | None, Ending(".html"), unset("FILE.html", "none")] = None
    """Write a page with figures, undetermined parameters, and pictures before and after."""
    choice: OmitArgPrefixes[SourceChoice] = SourceChoice()
    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from tracker.calibration import calibrate
        from tracker.formats.opening import open_recording
        from tracker.io.atomic import check_writable
        from tracker.io.progress import progress_bar

        known = self._known()
        for path in (self.out, self._guess):
            if path.exists():
                raise ValueError(f"{path}: is there already, choose another folder")
        check_writable(self.out)
        recording = open_recording(self.source, self.choice.options(images=False), strict=False)
        try:
            found = calibrate(
                self._believed(recording), known, lambda items, total: progress_bar(items, desc="pairs", total=total, leave=False, disable=self.json)
            )
        except ValueError as error:
            raise ValueError(f"{self.source}: {error}") from None
        self._write(recording, found)
        if found.problems:
            for line in found.problems:
                print(f"not known: {line}", file=sys.stderr)
            if len(recording.fixed) > 1 and self.clock < FAR_CLOCK:
                apart = f"clocks were taken to be at most {self.clock:g} s apart"
                print(f"{apart}; if they may be further apart, repeat with --clock {FAR_CLOCK:g}", file=sys.stderr)
            sys.exit(UNKNOWN)

    @property
    def _guess(self) -> Path:
        return self.out.with_name(self.out.name + ".guess")

    def _known(self) -> Known:
        """The knowledge that the options give. Raises ValueError for an invalid option."""
        from tracker.calibration import Known

        heights = dict(_named_number("--height", text, METRES) for text in self.height)
        distances = {}
        for text in self.distance:
            names, m = _named_number("--distance", text, METRES)
            first, comma, second = names.partition(",")
            if not comma or not first or not second:
                raise ValueError(f"--distance is {text!r}, needs two names, as in C1,C2=4.2")
            distances[first, second] = m
        stature = None if self.stature == "none" else _positive(self.stature)
        if stature is None and self.stature != "none":
            raise ValueError(f"--stature is {self.stature!r}, needs {METRES} above 0")
        if not 0 <= self.clock <= MOST_CLOCK:
            raise ValueError(f"--clock is {self.clock:g}, needs 0 to {MOST_CLOCK:g} s")
        return Known(heights, distances, stature, self.principal, self.k1, refine=self.from_ == "current", clock=self.clock)

    def _believed(self, recording: Recording) -> Recording:
        """The recording with the camera parameters that --from keeps. Raises ValueError where nothing is left to estimate."""
        from tracker.geometry.cameras import LensCamera

        named = [
            *(text.partition("=")[0] for text in (*self.height, *self.pixel_aspect)),
            *(name for text in self.distance for name in text.partition("=")[0].split(",")),
        ]
        if unknown := [name for name in named if name not in recording.fixed]:
            raise ValueError(f"{self.source}: camera is {unknown[0]!r}, needs one of {', '.join(recording.fixed)}")
        if self.from_ == "given" and not any(camera.unknown for camera in recording.fixed.values()):
            raise ValueError(f"{self.source}: all cameras have R and t; --from current finds what of them has moved, --from nothing forgets them")
        cameras = dict(recording.cameras)
        if self.from_ in ("nothing", "intrinsics"):
            for name, camera in recording.fixed.items():
                cameras[name] = camera.without_pose(self.from_ == "intrinsics" or camera.camera.wraps)
        same = [name for name in recording.fixed if isinstance(cameras[name].camera, LensCamera) and "K" not in cameras[name].unknown]
        if same and (self.principal or self.k1):
            print(f"--principal and --k1 change nothing of {', '.join(same)}, whose K is known; --from nothing forgets it", file=sys.stderr)
        return replace(recording, cameras=self._with_pixels(cameras))

    def _with_pixels(self, cameras: dict[str, RecordingCamera]) -> dict[str, RecordingCamera]:
        """The cameras with the pixel aspect of --pixel-aspect, or of PAL or NTSC, which is printed. Raises ValueError for a camera with K."""
        from tracker.geometry.cameras import Pinhole

        given, out = dict(_named_number("--pixel-aspect", text, "a number") for text in self.pixel_aspect), dict(cameras)
        for name, camera in cameras.items():
            model = camera.camera
            if "K" in camera.unknown and isinstance(model, Pinhole):
                ratio = given.get(name, model.fy / model.fx)
                out[name] = replace(camera, camera=replace(model, fy=ratio * model.fx))
                if name not in given and ratio != 1:
                    size = f"{name}: {model.width} x {model.height} px is a size of PAL or NTSC video"
                    wide = f"so its pixels are taken as {ratio:.3f} times as wide as high"
                    print(f"{size}, {wide}; `--pixel-aspect {name}=1` makes them squares", file=sys.stderr)
            elif name in given:
                raise ValueError(f"--pixel-aspect names {name}, whose K is known; --from nothing forgets it")
        return out

    def _write(self, recording: Recording, found: Calibration) -> None:
        from tracker.io.atomic import new_folder, write_text
        from tracker.recordings.folder import write_recording

        whole = found.applied(recording)
        if found.moved_frame and (recording.truth is not None or recording.area is not None or recording.occluders is not None):
            print("truth, area and terrain of the source are left out: the new world is another one", file=sys.stderr)
        if left := [name for name in recording.cameras if name not in whole.cameras]:
            print(f"{', '.join(left)}: left out, as the new world is another one; cameras need boxes and to stand still", file=sys.stderr)
        folder = self._guess if found.problems else self.out
        with new_folder(folder) as part:
            write_recording(part, whole)
            write_text(part / "calibrated.json", json_text(found.to_json(), indent=1) + "\n")
        paths = tuple(place for _, place in found.paths.values())
        if found.cameras:
            self._show(recording, whole.choose(list(found.cameras)), found, paths)
        if self.json:
            print(json_text({"out": str(folder)} | found.to_json(), indent=1))
        else:
            moved = found.changes or (["nothing has moved beyond its errors"] if self.from_ == "current" and not found.problems else [])
            reads = "" if found.problems else f"; `pilsim track {folder}` reads it"
            print("\n".join([*found.lines(), *moved, f"{folder}: {len(found.cameras)} cameras{reads}"]))

    def _show(self, recording: Recording, shown: Recording, found: Calibration, paths: tuple[Array, ...]) -> None:
        """The picture and the page of a result with cameras. shown: the recording with them."""
        if self.picture is not None:
            _draw(shown, self.picture, paths)
        if self.page is not None:
            from sim.report.calibration_page import write_calibration_page

            placed = all("pose" not in camera.unknown for camera in recording.fixed.values())
            pictures = ({"Before": _drawn(recording, ())} if placed else {}) | {"After": _drawn(shown, paths)}
            command = command_line(self, ("picture", "page", "json"), repeated=("height", "distance", "pixel_aspect", "detections"))
            write_calibration_page(self.page, found, pictures, command)


def _draw(recording: Recording, path: Path, paths: tuple[Array, ...]) -> str:
    """Draw the calibration of a recording. Returns the findings of its check as sentences."""
    from sim.visualization.calibration_picture import draw_calibration
    from tracker.recordings.calibration_check import check_calibration

    report = check_calibration(recording)
    draw_calibration(recording, report, path, paths)
    return " ".join(f"{finding.words}." for finding in report.findings[:3]) or "Nothing looks wrong."


def _drawn(recording: Recording, paths: tuple[Array, ...]) -> tuple[str, bytes]:
    """As `_draw`, with the bytes of the picture, which is not kept."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.png"
        return _draw(recording, path, paths), path.read_bytes()


def _named_number(option: str, text: str, what: str) -> tuple[str, float]:
    """Parse NAME=NUMBER. Raises ValueError for anything else, with the message that `what` above 0 is needed."""
    name, _, number = text.rpartition("=")
    value = _positive(number)
    if not name or value is None:
        raise ValueError(f"{option} is {text!r}, needs a name and {what} above 0")
    return name, value


def _positive(text: str) -> float | None:
    """A number above 0 and below 10,000; None for another text."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if 0.0 < value < 1e4 else None
