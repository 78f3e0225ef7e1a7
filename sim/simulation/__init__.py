"""The physics: a world with its rovers and people, stepped together by the only `mj_step`.

Read `simulation.py` first."""
