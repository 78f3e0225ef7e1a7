"""Calls on several processes or a Dask cluster, and a file lock that ends with its process.

Read `pool.py` first."""
