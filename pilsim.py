"""The entry point of the command `pilsim`; `python -m pilsim` is the same.

Ctrl-C during the imports of the command line, which take a second, ends the process at once: nothing has begun then, and a package may swallow an
exception.
"""

import os
import signal
import sys

CODE = 130
"""Exit code after Ctrl-C, as shells give it: 128 and the number of the signal."""


def main() -> None:
    """Run the command line. The exit code is 0, 2 with one line for bad input, or 130 when interrupted."""
    heeded = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if heeded:
        signal.signal(signal.SIGINT, _end)
    from sim.cli.main import main as run

    if heeded:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    run()


def _end(*_: object) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.stderr is not None:
        os.write(2, b"interrupted\n")
    os._exit(CODE)


if __name__ == "__main__":
    main()
