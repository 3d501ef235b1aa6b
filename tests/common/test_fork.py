"""Work in a process of its own, beside this one; what it leaves behind when it is ended."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time

import pytest

from palpate.common.processes import Fork, can_copy, shared_out

ALONE = """
import os, signal, sys, time
from palpate.common.processes import Fork, shared_out
def work():
    os.kill(os.getpid(), signal.SIGINT)
    return os.getpid(), list(range(100_000))
with Fork(work) as fork:
    who, numbers = fork.result()
assert who != os.getpid() and len(numbers) == 100_000
def failing():
    raise ValueError(os.getpid())
with Fork(failing) as fork:
    try:
        fork.result()
    except ValueError as error:
        assert error.args == (os.getpid(),)
    else:
        raise SystemExit("it did not fail")
start = time.perf_counter()
with Fork(lambda: time.sleep(60)) as fork:
    assert fork.running and fork.sent() is None
assert not fork.running
assert time.perf_counter() - start < 30
begun, left = os.pipe(), os.pipe()
def tidy():
    try:
        os.write(begun[1], b"b")
        time.sleep(60)
    finally:
        os.write(left[1], b"l")
with Fork(tidy):
    os.read(begun[0], 1)
os.set_blocking(left[0], False)
assert os.read(left[0], 1) == b"l"
with Fork(lambda: 1) as fork:
    while fork.running:
        pass
    assert fork.sent() == fork.result() == 1
with Fork(failing) as fork:
    while fork.running:
        pass
    assert fork.sent() is None, "it failed"
with Fork(os.getpid, copied=False) as fork:
    assert fork.result() == os.getpid()
done = list(shared_out(lambda i: (i, os.getpid()), range(7)))
assert [i for i, _ in done] == list(range(7)) and done[0][1] == os.getpid()
assert len({who for _, who in done}) == min(7, len(os.sched_getaffinity(0)))
assert list(shared_out(str, ())) == []
with Fork(lambda: {who for _, who in shared_out(lambda i: (i, os.getpid()), range(7))}) as fork:
    assert len(fork.result()) == 1, "a copy is not copied again"
try:
    list(shared_out(lambda i: 1 // (6 - i), range(7)))
except ZeroDivisionError:
    pass
else:
    raise SystemExit("it did not fail")
"""


@pytest.mark.skipif(
    sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2,
    reason="there is no second processor",
)
def test_work_is_done_by_a_fork_and_its_error_is_raised_here() -> None:
    done = subprocess.run(
        [sys.executable, "-c", ALONE], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nothing is copied")
def test_work_is_done_here_if_no_fork_is_possible(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(_: object) -> None:
        raise BlockingIOError("Resource temporarily unavailable")

    monkeypatch.setattr("multiprocessing.context.ForkProcess.start", refused)
    monkeypatch.setattr("palpate.common.processes.can_copy", lambda: True)
    with Fork(os.getpid) as fork:
        assert fork.result() == os.getpid()


def test_a_process_with_threads_is_not_copied() -> None:
    stop = threading.Event()
    thread = threading.Thread(target=stop.wait)
    thread.start()
    try:
        assert not can_copy()
        with Fork(lambda: (os.getpid(), time.sleep(0))) as fork:
            assert fork.result()[0] == os.getpid()
        assert set(shared_out(lambda _: os.getpid(), range(7))) == {os.getpid()}
    finally:
        stop.set()
        thread.join()
