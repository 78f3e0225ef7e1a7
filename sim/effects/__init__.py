"""Errors of real cameras, each off by default: of lenses, sensors, shutters, compression and calibration.

Read `specification.py` first."""

from sim.effects.image_effects import ImageEffects
from sim.effects.specification import Effects, parse_effects

__all__ = ["Effects", "ImageEffects", "parse_effects"]
