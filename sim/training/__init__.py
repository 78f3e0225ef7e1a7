"""Training of the person detector on rendered images alone: data, network, loss, calibration and evaluation.

Read `training.py` first. The network needs the extra `train` (torch)."""
