"""Datasets of pilsim on disk: validating and describing them, and synthetic crowds for tests and studies.

Read `validation.py` first.
"""
