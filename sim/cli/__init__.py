"""The command `pilsim`: one command a file, with its options as a frozen dataclass and its work in `run`.

Read `main.py` first. A command imports what it works with when it runs, so that `--help` is fast.
"""
