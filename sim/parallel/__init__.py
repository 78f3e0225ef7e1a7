"""Parallel calls in processes or on a Dask cluster.

Read `pool.py` first."""

from sim.parallel.pool import Pool, WorkerLost

__all__ = ["Pool", "WorkerLost"]
