"""`pilsim report` and `pilsim compare`: results of trials as a page with plots, findings and paired differences.

Read `page.py` first."""

from sim.report.rows import read_rows

__all__ = ["read_rows"]
