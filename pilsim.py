"""The entry point of the command `pilsim`; `python -m pilsim` is the same.

It imports nothing that takes time at first, so that Ctrl-C during the imports of the command line is one line, too.
"""

import _thread
import sys

CODE = 130
"""Exit code after Ctrl-C, as shells give it: 128 and the number of the signal."""


def main() -> None:
    """Run the command line. The exit code is 0, 2 with one line for bad input, or 130 when interrupted."""
    sys.unraisablehook = _unraisable
    try:
        from sim.cli.main import main as run

        run()
    except KeyboardInterrupt:
        leave("interrupted")


def leave(message: str) -> None:
    """End the process after Ctrl-C with a line on standard error and exit code 130. Another Ctrl-C is ignored from here on."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Where a compiled module saw the signal first, CPython would end by the signal, and not with this code, unless something else is run by it.
    import ctypes

    ctypes.pythonapi.PyRun_SimpleString(b"")
    if sys.stderr is not None:
        print(message, file=sys.stderr)
    sys.exit(CODE)


def _unraisable(found: "sys.UnraisableHookArgs") -> None:
    """Ctrl-C in a place that cannot raise, as a callback of a compiler, comes again right after it."""
    if found.exc_type is KeyboardInterrupt:
        _thread.interrupt_main()
    else:
        sys.__unraisablehook__(found)


if __name__ == "__main__":
    main()
