"""`pilsim study`: studies of the paper's parameters: number of hypotheses, graphs of the clique search, and image tracklets.

Read `study_cells.py` first."""
