"""The command `pilsim doctor`: versions, OpenGL and rendering speed of this computer."""

from __future__ import annotations

import importlib
import platform
import time
from dataclasses import asdict, dataclass
from typing import Any

from sim.cli.options import json_text
from sim.parallel.pool import usable_cores
from sim.rendering.gl_context import GLUnavailable, choose_gl

PACKAGES = {"pilsim": "pilsim", "mujoco": "mujoco", "numpy": "numpy", "opencv": "opencv-python-headless", "numba": "numba"}


@dataclass(frozen=True)
class Doctor:
    """Report what this computer has: versions, OpenGL, rendering speed.

    The report names the OpenGL renderer, says whether it is a GPU, and measures the
    panoramas that it renders per second. It counts transfers to and from the driver.

    Example: pilsim doctor --json
    """

    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        report = examine()
        print(json_text(report, indent=1) if self.json else describe(report))


def examine(seconds: float = 3.0) -> dict[str, Any]:
    """Versions, platform, OpenGL and rendering speed as JSON values. The speed is measured for about `seconds` s.

    Without OpenGL, "gl", "speed" and "traffic" are None, and "fault" names what to install.
    """
    report: dict[str, Any] = {
        "versions": {"python": platform.python_version()} | {name: _version(package) for name, package in PACKAGES.items()},
        "platform": platform.platform(),
        "cores": usable_cores(),
        "backend": None,
        "gl": None,
        "speed": None,
        "traffic": None,
        "fault": None,
    }
    try:
        report["backend"] = choose_gl()
        report |= _rendering(seconds)
    except GLUnavailable as error:
        report["fault"] = str(error)
    return report


def describe(report: dict[str, Any]) -> str:
    """The report as text of several lines."""
    lines = [f"{name:10} {version}" for name, version in report["versions"].items()]
    lines += [f"{'platform':10} {report['platform']}", f"{'cores':10} {report['cores']}"]
    gl, speed = report["gl"], report["speed"]
    if gl is None or speed is None:
        return "\n".join([*lines, f"{'OpenGL':10} {report['fault']}"])
    lines += [
        f"{'OpenGL':10} {gl['version']}, by {report['backend']}",
        f"{'renderer':10} {gl['renderer']} ({gl['vendor']}): {'a GPU' if gl['gpu'] else 'the CPU'}",
        f"{'speed':10} {speed['panoramas']:.1f} panoramas a second, {speed['width']} x {speed['height']}, colour + instances + range,"
        f" {speed['scene']}, {speed['robots']} robots, {speed['people']} people",
    ]
    if (traffic := report["traffic"]) is not None:
        lines.append(
            f"{'traffic':10} a panorama: {traffic['uploads']:.1f} uploads of {traffic['uploaded_bytes'] / 1e6:.2f} MB,"
            f" {traffic['draws']:.0f} draw calls,"
            f" {traffic['read_backs']:.0f} read-backs of {traffic['read_bytes'] / 1e6:.1f} MB, each of which waits for the driver"
        )
    return "\n".join(lines)


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def _rendering(seconds: float) -> dict[str, Any]:
    """The OpenGL renderer, and its panoramas per second of the default scenario."""
    import numpy as np

    from sim.rendering.panorama import PanoramaRenderer
    from sim.scenario import Scenario
    from sim.simulation.simulation import Simulation
    from tracker.geometry.cameras import Panorama

    scenario = Scenario()
    simulation = Simulation(scenario)
    poses = [simulation.T_world_robot(robot) @ simulation.mount(robot) for robot in simulation.robots]
    camera = Panorama(scenario.width, scenario.height)
    with PanoramaRenderer(simulation.model, camera, simulation.person_of_geom.astype(np.uint16)) as renderer:
        information = renderer.information
        # The first panorama includes compilation by the driver and by numba.
        renderer.render(simulation.data, poses)
        before, started, drawn = renderer.traffic, time.perf_counter(), 0
        while not drawn or time.perf_counter() - started < seconds:
            drawn += len(renderer.render(simulation.data, poses))
        rate, traffic = drawn / (time.perf_counter() - started), renderer.traffic.since(before)
    size = {"width": camera.width, "height": camera.height}
    content = {"scene": scenario.world, "robots": scenario.robots, "people": scenario.people}
    gl = {"vendor": information.vendor, "renderer": information.renderer, "version": information.version, "gpu": information.is_gpu}
    passed = {name: count / drawn for name, count in asdict(traffic).items()}
    return {"gl": gl, "speed": {"panoramas": rate} | size | content, "traffic": passed}
