"""A scenario run frame by frame, rendered or by rays, and written as a sequence.

Read `record.py` first."""
