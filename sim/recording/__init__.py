"""Recording: a scenario is run frame by frame, rendered or by ray casting, and written as a sequence.

Read `record.py` first."""

from sim.recording.record import record

__all__ = ["record"]
