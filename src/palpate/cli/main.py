"""Entry point of the command line: signals, threads of linear algebra, and unexpected errors."""

from __future__ import annotations

import atexit
import gc
import os
import sys
import threading
from importlib import import_module
from typing import Any, NoReturn, cast

from palpate.common.processes import ending_signals, ignore_signals, interrupts

INTERRUPTED = 130  # Exit status of typer for a signal outside of a command
# New objects between two garbage collections. A program creates hardly any garbage while it loads.
# Python's default of 700 takes a sixth of the time of `palpate plan`.
GC_THRESHOLD = 100_000
GRACE = 0.1  # s: wait for a thread of palpate at exit


def main() -> None:
    """Run the command line; handle signals and errors that the commands do not handle."""
    # Use one BLAS thread: matrices are small, and the threads of parallel processes block each
    # other, ten times slower.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(GC_THRESHOLD)
    with interrupts(ending_signals()) as signals, signals.defer():
        try:
            _choose_opengl()
            from palpate.cli.app import app

            status = app(standalone_mode=False)
        # Every end of the program has one exit status and at most one message.
        except KeyboardInterrupt:
            status = INTERRUPTED
        except Exception as error:
            status = _report_error(error)
        if status == INTERRUPTED:
            from palpate.cli.console import print_error
            from palpate.common.errors import ExecutionAborted

            status = print_error(ExecutionAborted(signals.reason), "--json" in sys.argv)
        elif signals.count and status in (0, 1):
            from palpate.cli.console import say

            say(f"{signals.reason}, when all was done" if status == 0 else signals.reason)
        # A closed output costs the status of a successful command.
        if not _flush_stdout():
            status = status or 1
        atexit.register(ignore_signals)
        _leave(4 if signals.count else status)


def _leave(status: int) -> NoReturn:
    """End the process.

    If a thread of palpate is still inside a robot's C++ library, the interpreter's shutdown would
    abort the process there. The process then exits without it.
    """
    if not any(_inside_a_library(thread) for thread in threading.enumerate()):
        gc.freeze()  # nothing is collected at exit
        sys.exit(status)
    atexit._run_exitfuncs()  # pyright: ignore[reportPrivateUsage]
    sys.stderr.flush()
    os._exit(status)


def _inside_a_library(thread: threading.Thread) -> bool:
    if not (thread.daemon and thread.name.startswith("palpate ")):
        return False
    thread.join(GRACE)
    return thread.is_alive()


def _choose_opengl() -> None:
    """Disable pictures if `MUJOCO_GL` names an OpenGL with which MuJoCo cannot be imported.

    Without a choice, pictures on Linux use EGL or OSMesa. MuJoCo would import GLFW, which starts a
    process of its own.
    """
    chosen = os.environ.get("MUJOCO_GL", "").strip()
    if not chosen:
        if sys.platform == "linux":
            sys.modules.setdefault("glfw", cast("Any", None))  # a later import fails
        return
    try:
        import_module("mujoco")
    except Exception:
        from palpate.cli.console import say

        os.environ["MUJOCO_GL"] = "disable"
        say(f"no pictures: MuJoCo cannot use MUJOCO_GL={chosen}; unset it, or try egl or osmesa")


def _flush_stdout() -> bool:
    """Flush stdout; return True if all results were written."""
    try:
        sys.stdout.flush()
    except OSError:
        from palpate.cli.console import guard_printing

        with guard_printing():
            sys.stdout.flush()
        return False
    return True


def _report_error(error: Exception) -> int:
    """Print an error and return the exit status.

    An error of the command line library keeps its own words. An unexpected one is a line, or with
    `python -X dev` a traceback.
    """
    if type(error).__name__ == "Abort":
        return INTERRUPTED
    if type(error).__module__.split(".")[0] in ("click", "typer"):
        return usage(error, "--json" in sys.argv)
    if sys.flags.dev_mode:
        raise error
    from palpate.cli.console import print_error, say
    from palpate.common.errors import PalpateError

    if isinstance(error, OSError):
        # The output is probably full or closed: print nothing more there.
        say(str(error))
        return 1

    bug = PalpateError(f"unexpected {type(error).__name__}: {error}; python -X dev says where")
    return print_error(bug, "--json" in sys.argv)


def usage(error: Any, as_json: bool = False) -> int:
    """Print a usage error in the command line library's words, with --json also as JSON. Return the exit status."""
    from palpate.cli.console import guard_printing, print_failure
    from palpate.common.display import visible

    # The library's errors can show themselves with a usage line.
    status: int = getattr(error, "exit_code", 2)
    show = getattr(error, "show", None)
    if show:
        error.message = visible(error.message)
        if not error.message:  # no arguments at all: its help
            as_json = False
        show()
    else:
        print(f"palpate: {visible(str(error))}", file=sys.stderr)
    if as_json:
        with guard_printing():
            print_failure(error.format_message() if show else str(error), status)
    return status


if __name__ == "__main__":
    main()
