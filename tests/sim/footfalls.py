"""Measurements of walking people in a simulation: gaps and slides of soles, motion of legs."""

from __future__ import annotations

import numpy as np

from sim.pedestrian import foot_contact, skeleton
from sim.simulation.simulation import Simulation
from tracker.geometry import Array

_HIPS, _KNEES, _ANKLES = slice(11, 13), slice(13, 15), slice(15, 17)


class Footfalls:
    """Measurements over `frames` frames of a simulation.

    gap: smallest distance between a standing sole and the terrain, m. slide: smallest motion of a sole's points between two frames, m.
    flexion: of the knees, degrees. hips: height of the pelvis above the ground, a share of the stature of an adult with such legs.
    sinking: vertical speed of the pelvis, m/s.
    """

    def __init__(self, simulation: Simulation, frames: int) -> None:
        self._simulation = simulation
        self._size = skeleton.trunk_size(simulation.stature)
        names = [[f"person_{p}/{side}_shoe" for side in ("left", "right")] for p in simulation.all_persons]
        self._shoes = np.array([[simulation.model.body(name).id for name in pair] for pair in names])
        gaps, slides, flexion, hips = [], [], [], []
        last, height = None, []
        for _ in range(frames):
            simulation.step()
            sole, standing = self._soles(), simulation._footing.standing & np.isin(simulation.all_persons, simulation.persons)[:, None]
            above = sole[..., 2] - simulation.world.terrain.height_at(sole[..., :2].reshape(-1, 2)).reshape(sole.shape[:-1])
            gaps.append(above.min(axis=2)[standing])
            if last is not None:
                slides.append(np.linalg.norm(sole - last[0], axis=3).min(axis=2)[standing & last[1]])
            last = sole, standing
            joints = simulation.joints()
            flexion.append(_flexion(joints))
            height.append(joints[:, _HIPS, 2].mean(axis=1))
            hips.append((height[-1] - simulation.feet()[:, 2]) / self._size)
        self.gap, self.slide = np.abs(np.concatenate(gaps)), np.concatenate(slides)
        self.flexion, self.hips = np.concatenate(flexion), np.concatenate(hips)
        self.sinking = np.abs(np.diff(height, axis=0)) / simulation.scenario.period

    def _soles(self) -> Array:
        """(m, 2, 12, 3) m: points of all soles."""
        along, aside = np.meshgrid(np.linspace(-foot_contact.HEEL, foot_contact.PIVOT, 6), [-foot_contact.HALF_SOLE, foot_contact.HALF_SOLE])
        points = np.stack([along.ravel(), aside.ravel(), np.full(12, -foot_contact.ANKLE)], axis=1)
        data = self._simulation.data
        R = data.xmat[self._shoes].reshape(*self._shoes.shape, 3, 3)
        return data.xpos[self._shoes][:, :, None] + np.einsum("mfij,kj->mfki", R, points) * self._size[:, None, None, None]

    def are_human(self) -> None:
        """Feet neither slide nor float nor sink, nobody walks on folded knees or drops into the hips."""
        assert self.slide.max() < 0.03
        assert self.gap.max() < 0.02
        # As on stairs: some 90 to 100 degrees (Riener, Rabuffetti, Frigo 2002, Stair ascent and descent at different inclinations).
        assert np.quantile(self.flexion, 0.999) < 105
        assert self.flexion.max() < 120
        # 0.53 is that of somebody who stands upright; less with one foot far below or ahead.
        assert np.quantile(self.hips, 0.001) > 0.40
        assert np.quantile(self.hips, 0.999) < 0.62
        assert np.quantile(self.sinking, 0.99) < 1.0


def _flexion(joints: Array) -> Array:
    """Bend (m, 2) of the knees, degrees."""
    thigh, shin = joints[:, _HIPS] - joints[:, _KNEES], joints[:, _ANKLES] - joints[:, _KNEES]
    cosine = (thigh * shin).sum(axis=2) / (np.linalg.norm(thigh, axis=2) * np.linalg.norm(shin, axis=2))
    return 180.0 - np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
