"""The gymnasium environment `pilsim/Placement-v0`, in which actions place the robots, and its PettingZoo twin.

Read `env.py` first."""
