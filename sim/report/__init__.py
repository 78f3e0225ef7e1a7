"""`pilsim report` and `pilsim compare`: results of trials as a page with plots, findings and paired differences.

Read `report.py` first."""
