"""Tests and benchmarks. Importing `sim` first sets the threads of OpenBLAS, as every command does, before numpy is loaded."""

import sim  # noqa: F401
