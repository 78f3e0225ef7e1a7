"""From the pictures of lenses to the images that cameras hand on: effects of the lens, exposure, stitching, and effects of processing.

Random numbers are drawn frame by frame, in their order. The truth of a view does not change.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from sim.effects import ImageEffects
from sim.recording.shots import MountedRig, mounted_rigs
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tracker.geometry import Image
from tracker.types import Setup

TIME_CONSTANT = 3.0
"""s: time constant of the drift of exposure."""


class Exposure:
    """Exposure and noise of one view, frame by frame.

    stops: sigma of the exposure drift in stops (factors of two), a stationary Ornstein-Uhlenbeck process (Uhlenbeck & Ornstein 1930).
    noise: sigma of white noise in every pixel and channel, in counts of 255. period: s between frames.
    If both are 0, images pass unchanged and nothing is drawn from rng.
    """

    def __init__(self, stops: float, noise: float, period: float, rng: np.random.Generator) -> None:
        self._stops, self._noise, self._rng = stops, noise, rng
        self._decay = math.exp(-period / TIME_CONSTANT)
        self._stops_now = rng.normal(0.0, stops) if stops else 0.0

    def apply(self, picture: Image) -> Image:
        """The image (H, W, 3) of the next frame, with exposure and noise applied."""
        if not self._stops and not self._noise:
            return picture
        light = picture.astype(np.float32)
        if self._stops:
            light *= np.float32(2.0**self._stops_now)
            self._stops_now = self._decay * self._stops_now + math.sqrt(1 - self._decay**2) * self._rng.normal(0.0, self._stops)
        if self._noise:
            light += np.float32(self._noise) * self._rng.standard_normal(picture.shape, dtype=np.float32)
        return np.asarray(np.clip(np.rint(light), 0, 255), dtype=np.uint8)


class CameraColours:
    """The colours of all views, frame by frame.

    changed: whether an image can differ from the picture of its lens.
    """

    def __init__(self, scenario: Scenario, rigs: list[MountedRig]) -> None:
        self._rigs, drift = rigs, (scenario.exposure, scenario.image_noise, scenario.period)
        self.changed = bool(scenario.effects or scenario.exposure or scenario.image_noise) or any(mounted.rig.stitching for mounted in rigs)
        self._lens = _lens_effects(scenario, rigs)
        self._exposure = {name: Exposure(*drift, scenario.stream(f"exposure/{name}")) for name in self._lens}
        self._view: dict[str, ImageEffects] = {}
        for mounted in rigs:
            for view in mounted.rig.views:
                name = mounted.name + view.suffix
                self._view[name] = ImageEffects(scenario.camera_effects, view.camera, scenario.stream(f"effects/{name}/view"))

    def images(self, lenses: Mapping[str, Image]) -> dict[str, Image]:
        """Camera → image (H, W, 3) of the next frame. lenses: name → picture (H, W, 3) of every lens."""
        out = {}
        for mounted in self._rigs:
            rig = mounted.rig
            captured = {lens.suffix: self._captured(mounted.name + lens.suffix, lenses[mounted.name + lens.suffix]) for lens in rig.lenses}
            for view in rig.views:
                name = mounted.name + view.suffix
                if rig.stitching is None or view.suffix:
                    colour = captured[view.suffix]
                else:
                    front, back = captured.values()
                    colour = rig.stitching.stitched((front, back))
                out[name] = self._view[name].processed(colour)
        return out

    def skip(self) -> None:
        """Draw the random numbers of the next frame, whose images are known."""
        for mounted in self._rigs:
            for lens in mounted.rig.lenses:
                self._captured(mounted.name + lens.suffix, np.zeros((lens.camera.height, lens.camera.width, 3), np.uint8))

    def _captured(self, name: str, picture: Image) -> Image:
        return self._exposure[name].apply(self._lens[name].captured(picture))


def _lens_effects(scenario: Scenario, rigs: list[MountedRig]) -> dict[str, ImageEffects]:
    """Name of each lens → its effects."""
    effects, out = scenario.camera_effects, {}
    for mounted in rigs:
        stops = (effects.seam or 0.0) / 2 if mounted.rig.stitching else 0.0
        for lens, sign in zip(mounted.rig.lenses, (1, -1), strict=False):
            name = mounted.name + lens.suffix
            out[name] = ImageEffects(effects, lens.camera, scenario.stream(f"effects/{name}"), sign * stops)
    return out


def effect_rows(simulation: Simulation, setup: Setup) -> list[list[object]]:
    """Rows of truth/effects.csv: camera, effect, value (degrees and m for errors of mounts), and for specks and drops their middle and radius, px."""
    scenario = simulation.scenario
    rigs, given, out = mounted_rigs(simulation, setup), scenario.camera_effects.given(), list[list[object]]()
    for name, chain in _lens_effects(scenario, rigs).items():
        for effect, value in given.items():
            if effect in ("dust", "drops"):
                out += [[name, spot.effect, spot.opacity, spot.u, spot.v, spot.radius] for spot in chain.spots if spot.effect == effect]
            elif effect not in ("mount_angle", "mount_shift") and (effect != "seam" or chain.stops):
                out.append([name, effect, chain.stops if effect == "seam" else value, 0.0, 0.0, 0.0])
    errors = [(effect, given[effect]) for effect in ("mount_angle", "mount_shift") if effect in given]
    return out + [[mounted.name, effect, value, 0.0, 0.0, 0.0] for mounted in rigs for effect, value in errors]
