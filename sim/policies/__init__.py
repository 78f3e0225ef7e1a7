"""Policies that place robots, their training and their comparison.

Read `policy.py` first."""

from sim.policies.policy import Policy, TeamKnowledge, waypoint_action

__all__ = ["Policy", "TeamKnowledge", "waypoint_action"]
