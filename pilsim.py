"""The entry point of the command `pilsim`; `python -m pilsim` is the same.

It imports nothing at first, so that Ctrl-C during the imports of the command line is one line, too.
"""

import sys


def main() -> None:
    """Run the command line. The exit code is 0, 2 with one line for bad input, or 130 when interrupted."""
    try:
        from sim.cli.main import main as run
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
