"""A scene compiled in a process of its own first, which may use so much memory and time and no
more: for scenes that may be larger than their text tells.

`python -m palpate.mjcf.limits.trial FOLDER` is that process; it reads the MJCF and what that attaches
from standard input, as JSON.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from palpate.errors import InputError

MEMORY = 700_000_000
"""Bytes that compiling may take, on top of the interpreter and MuJoCo."""

SECONDS = 2
"""s of processor time for it: a mesh of 190 000 faces, nearly the most that MuJoCo reads, takes 1.4
where its points are those of a surface, and minutes where each face has points of its own."""

WALL_SECONDS = 30.0
"""s on the clock, which is more where others compute, too."""


def require_compiles(
    xml: str, folder: Path | None, what: str = "the scene", parts: Mapping[str, str] | None = None
) -> None:
    """See whether MuJoCo compiles it within bounds, `parts` in the place of files that it attaches.
    What MuJoCo itself finds wrong with it is left to whoever compiles it here.

    Raises:
        InputError: it takes more memory or time.
    """
    command = [sys.executable, "-m", __name__, str(folder or "")]
    try:
        done = subprocess.run(
            command,
            input=json.dumps([xml, dict(parts or {})]).encode("utf-8"),
            env=_environment(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=WALL_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise _too_heavy(what) from None
    if done.returncode != 0:
        raise _too_heavy(what)


def _too_heavy(what: str) -> InputError:
    return InputError(
        f"compiling {what} takes more than {SECONDS} s or {MEMORY // 1_000_000} MB; use fewer and "
        "smaller meshes, flexible things and replicated bodies"
    )


def _environment() -> dict[str, str]:
    """This process's, with its modules, and without threads, whose memory would count."""
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        "MALLOC_ARENA_MAX": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }


def main() -> int:
    """Compile what comes on standard input, and look at it once; 0 also where MuJoCo refuses it,
    1 where there is no memory for it."""
    import mujoco

    folder, (xml, parts) = sys.argv[1], json.loads(sys.stdin.buffer.read())
    include = {name: text.encode("utf-8") for name, text in parts.items()}
    _limit()
    try:
        spec = mujoco.MjSpec.from_string(xml, include=include)
        spec.modelfiledir = folder
        spec.compiler.usethread = False
        model = spec.compile()
        mujoco.mj_kinematics(model, mujoco.MjData(model))
    except MemoryError:
        return 1
    except (ValueError, mujoco.FatalError) as error:
        return int("memory" in str(error))
    return 0


def _limit() -> None:
    """Bound this process; where the system has no such bounds, only the clock does."""
    try:
        import resource
    except ImportError:
        return
    # Its signal, which nobody handles, ends the process; RLIMIT_CPU counts whole seconds.
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if (memory := _address_space()) is not None:
        resource.setrlimit(resource.RLIMIT_AS, (memory + MEMORY, memory + MEMORY))


def _address_space() -> int | None:
    """Bytes of address space in use; None where nobody tells."""
    try:
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    except OSError:
        return None
    return pages * os.sysconf("SC_PAGE_SIZE")


if __name__ == "__main__":
    sys.exit(main())
