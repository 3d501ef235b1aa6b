"""The entry point: it takes the signals, and sees to the threads of linear algebra, before anything heavy
is loaded."""

from __future__ import annotations

import atexit
import gc
import os
import sys
import threading
from importlib import import_module
from typing import Any, NoReturn

from palpate.interrupt import ending_signals, ignore_signals, interrupts

INTERRUPTED = 130
"""Exit status of typer for a signal outside of a command."""
LITTER = 100_000
"""Objects more than before, after which Python looks for garbage. While a program is loaded, hardly
anything is: to look every 700 objects takes a sixth of the time that `palpate plan` does."""
GRACE = 0.1
"""s that a thread of ours is waited for at the end."""


def main() -> None:
    """Entry point of the command line; handles what the commands themselves do not."""
    # Small matrices: the threads of processes side by side wait for each other, ten times as long.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(LITTER)
    with interrupts(ending_signals()) as signals, signals.noted():
        try:
            _without_broken_opengl()
            from palpate.cli.app import app

            status = app(standalone_mode=False)
        except KeyboardInterrupt:
            status = INTERRUPTED
        except Exception as error:
            status = _told(error)
        if status == INTERRUPTED:
            status = _interrupted(signals.reason)
        elif signals.count and status in (0, 1):
            from palpate.cli.console import say

            say(f"{signals.reason}, when all was done" if status == 0 else signals.reason)
        if not _flushed():
            status = status or 1
        atexit.register(ignore_signals)
        _leave(4 if signals.count else status)


def _leave(status: int) -> NoReturn:
    """End the process. A thread of ours that is still inside a robot's library then would be torn out of
    it while Python shuts down, which C++ answers by aborting the process."""
    if not any(_inside_a_library(thread) for thread in threading.enumerate()):
        sys.exit(status)
    atexit._run_exitfuncs()  # pyright: ignore[reportPrivateUsage]
    sys.stderr.flush()
    os._exit(status)


def _inside_a_library(thread: threading.Thread) -> bool:
    if not (thread.daemon and thread.name.startswith("palpate ")):
        return False
    thread.join(GRACE)
    return thread.is_alive()


def _without_broken_opengl() -> None:
    """Go on without pictures where `MUJOCO_GL` names an OpenGL with which MuJoCo cannot even be
    imported."""
    chosen = os.environ.get("MUJOCO_GL", "").strip()
    if not chosen:
        return
    try:
        import_module("mujoco")
    except Exception:
        from palpate.cli.console import say

        os.environ["MUJOCO_GL"] = "disable"
        say(f"no pictures: MuJoCo cannot use MUJOCO_GL={chosen}; unset it, or try egl or osmesa")


def _flushed() -> bool:
    """True if all that was printed has arrived; results that cannot be told are no success."""
    try:
        sys.stdout.flush()
    except OSError:
        from palpate.cli.console import printing

        with printing():
            sys.stdout.flush()
        return False
    return True


def _interrupted(reason: str) -> int:
    from palpate.cli.console import print_error
    from palpate.errors import ExecutionAborted

    return print_error(ExecutionAborted(reason), "--json" in sys.argv)


def _told(error: Exception) -> int:
    """An error of the command line library is told by itself; what nobody expected in one line, by
    `python -X dev` in full."""
    if type(error).__name__ == "Abort":
        return INTERRUPTED
    if type(error).__module__.split(".")[0] in ("click", "typer"):
        return usage(error, "--json" in sys.argv)
    if sys.flags.dev_mode:
        raise error
    from palpate.cli.console import print_error, say
    from palpate.errors import PalpateError

    if isinstance(error, OSError):
        # Mostly the output that is full, or gone: nothing more is printed there.
        say(str(error))
        return 1

    found = PalpateError(f"unexpected {type(error).__name__}: {error}; python -X dev says where")
    return print_error(found, "--json" in sys.argv)


def usage(error: Any, as_json: bool = False) -> int:
    """Tell a wrong option or argument in the command line library's own words, and as an object where
    JSON is wanted; the exit status."""
    from palpate.cli.console import print_failure, printing
    from palpate.display import visible

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
        with printing():
            print_failure(error.format_message() if show else str(error), status)
    return status


if __name__ == "__main__":
    main()
