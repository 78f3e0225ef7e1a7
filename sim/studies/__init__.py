"""`pilsim study`: the questions of the paper, each answered by an experiment.

Read `hypothesis_count.py` first."""
