"""Recording: a scenario is run frame by frame, rendered or by ray casting, and written as a sequence.

Read `record.py` first."""
