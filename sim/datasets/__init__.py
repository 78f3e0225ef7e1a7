"""Datasets of many sequences: presets, fixed cameras, resumable generation, and the twin of PETS 2009.

Read `generation.py` first."""

from sim.datasets.presets import PRESETS, Preset, preset_of

__all__ = ["PRESETS", "Preset", "preset_of"]
