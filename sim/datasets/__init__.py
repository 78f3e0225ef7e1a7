"""Datasets of many sequences: presets, fixed cameras, resumable generation, and twins of recordings.

Read `generation.py` first."""

from sim.datasets.presets import PRESETS, Preset, preset_of

__all__ = ["PRESETS", "Preset", "preset_of"]
