"""Maximum-weight cliques: breakout local search, branch and bound, and Lagrangian bounds.

Read `local_search.py` first."""
