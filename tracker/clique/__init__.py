"""Maximum-weight cliques: breakout local search, branch and bound, and Lagrangian bounds.

Read `local_search.py` first."""

from tracker.clique.local_search import Found, Graph, Limits, Options, search

__all__ = ["Found", "Graph", "Limits", "Options", "search"]
