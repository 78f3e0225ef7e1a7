"""The entry point of the command `pilsim`; `python -m pilsim` is the same.

It imports only what the interpreter has loaded already, so that Ctrl-C during the imports of the command line is one line, too.
"""

import _signal  # type: ignore[import-not-found]
import _thread
import sys
import time

CODE = 130
"""Exit code after Ctrl-C, as shells give it: 128 and the number of the signal."""
MOMENT = 0.02
"""Time after which Ctrl-C comes again where it was lost, s."""
_interrupted: list[int] = []
"""The signals of Ctrl-C that came."""


def main() -> None:
    """Run the command line. The exit code is 0, 2 with one line for bad input, or 130 when interrupted."""
    sys.unraisablehook = _unraisable
    if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
        _signal.signal(_signal.SIGINT, _interrupt)
    try:
        from sim.cli.main import main as run

        if _interrupted:  # A package took no notice of it.
            raise KeyboardInterrupt
        run()
    except KeyboardInterrupt:
        leave("interrupted")
    except Exception:
        # Some packages turn Ctrl-C during their import into an ImportError.
        if not _interrupted:
            raise
        leave("interrupted")


def _interrupt(number: int, _: object) -> None:
    _interrupted.append(number)
    raise KeyboardInterrupt


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
    """Ctrl-C in a place that cannot raise, as a callback of a compiler, comes again a moment later."""
    if found.exc_type is KeyboardInterrupt:
        _thread.start_new_thread(_again, ())
    else:
        sys.__unraisablehook__(found)


def _again() -> None:
    time.sleep(MOMENT)
    _thread.interrupt_main()


if __name__ == "__main__":
    main()
