"""The gymnasium environment `pilsim/Placement-v0`, in which actions place the robots, and its PettingZoo counterpart.

Read `env.py` first."""

from sim.placement.config import PlacementConfig

__all__ = ["PlacementConfig"]
