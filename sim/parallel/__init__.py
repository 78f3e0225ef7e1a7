"""Parallel calls in processes or on a Dask cluster, and a file lock that ends with its process.

Read `pool.py` first."""
