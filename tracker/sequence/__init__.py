"""pilsim's own recording folder: schema, calibration, truth tables, writer, reader, and the results of tracking.

Read `reader.py` first.
"""

from tracker.sequence.reader import read_sequence
from tracker.sequence.results import Results, read_results

__all__ = ["Results", "read_results", "read_sequence"]
