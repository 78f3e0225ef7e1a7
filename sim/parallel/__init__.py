"""Parallel calls in processes or on a Dask cluster, and a file lock that ends with its process.

Read `pool.py` first."""

from sim.parallel.pool import Pool, WorkerLost

__all__ = ["Pool", "WorkerLost"]
