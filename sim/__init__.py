"""The simulator. Importing it registers the gymnasium environment `pilsim/Placement-v0`."""

import gymnasium

gymnasium.register("pilsim/Placement-v0", "sim.placement:Placement", max_episode_steps=240)
