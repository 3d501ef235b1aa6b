"""A film drawn while the arm moves is the one that would be drawn afterwards."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from palpate.perception import film as module
from palpate.perception.film import Footage, Reel, Shot
from palpate.perception.renderer import gl_available
from palpate.trace.recording import LeafRun
from palpate.trace.samples import Samples

usable, reason = gl_available()

RUN = """
import os, signal
import mujoco
import numpy as np
from palpate.common.processes import can_copy
from palpate.perception.film import Footage, Shot, film_of
from palpate.perception.film import Reel
from palpate.trace.recording import LeafRun, NominalHand
from palpate.trace.samples import Samples, Trace

BALL = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
  <body name="table" pos="0 0 0.5"><geom type="box" size=".3 .4 .02"/></body>
  <body name="ball" pos="0 0 .6"><freejoint/><geom size=".05" rgba="1 0 0 1"/></body>
</worldbody></mujoco>''')
HAND = NominalHand(0.009, 0.15, 0.01, 1e-4)
t = np.arange(0.0, 6.0, 0.005)
flat, pose = np.zeros((len(t), 7)), np.zeros((len(t), 7))
force = np.outer(t, [0, 0, 1, 0, 0, 0])
samples = Samples(t, flat, flat, flat, force, pose, force, pose, t)
leaves = [LeafRun("", "", f"leaf {i}", 1.0 * i, i + 1.0, "SUCCESS") for i in range(6)]
frames = [(i / 30, np.array([0, 0, 0.6 + 0.01 * i / 30, 1, 0, 0, 0])) for i in range(181)]
trace, whole = Trace(samples, tuple(leaves), (), (), HAND), Footage(BALL, tuple(frames))

def reel(planned, then=lambda copy: None):
    seen = []
    with Reel(lambda: Footage(BALL, tuple(seen)), lambda: planned if len(seen) > 50 else None) as reel:
        for i in range(6):
            seen += [frame for frame in frames if i <= frame[0] < i + 1]
            first = 3 * (i // 3)  # of two attempts
            reel.look(samples.between(i, i + 0.999), leaves[first : i + 1])
        begun = reel._copy
        then(begun)
        made = reel.finish(whole, trace)
        return begun, made and made.result()

same = Shot.of(whole)
begun, film = reel(same)
assert (begun is not None) is can_copy()
if begun:
    _, again = reel(same, then=lambda copy: os.kill(copy._copy.pid, signal.SIGKILL))
    assert reel(Shot(same.speed, same.points + 0.1))[1] is None, "another view"
    assert reel(Shot(2 * same.speed, same.points))[1] is None, "another speed"
    afterwards = film_of(whole, trace)
    assert film == afterwards, (len(film.mp4), len(afterwards.mp4))
    assert again == afterwards, "of a copy that was killed"
"""


@pytest.mark.skipif(not usable, reason=reason)
def test_a_film_drawn_meanwhile_is_that_of_the_end() -> None:
    """In a process of its own: one that has drawn is not copied."""
    subprocess.run([sys.executable, "-c", RUN], check=True, timeout=120)


class Copy:
    """Stands for a copy of this process that draws."""

    open = 0

    def __init__(self, _: Any) -> None:
        self.open, Copy.open = True, Copy.open + 1

    def close(self) -> None:
        Copy.open -= self.open
        self.open = False


@pytest.mark.parametrize("fails", ["the camera", "the shot", "a chunk", "the end", ""])
def test_a_film_that_fails_ends_no_run_and_is_made_again(
    monkeypatch: pytest.MonkeyPatch, fails: str
) -> None:
    asked: list[str] = []

    def ask(what: str, answer: Any) -> Any:
        asked.append(what)
        if what == fails:
            raise ValueError("need at least one array to concatenate")
        return answer

    for name, answer in {"can_copy": True, "gl_available": (True, ""), "Fork": Copy}.items():
        monkeypatch.setattr(module, name, answer if name == "Fork" else lambda a=answer: a)
    monkeypatch.setattr(module, "Painter", SimpleNamespace(used=False))
    monkeypatch.setattr(module, "captions", lambda *_: ask("a chunk", []))
    monkeypatch.setattr(Shot, "of", classmethod(lambda *_: ask("the end", shot)))
    monkeypatch.setattr(Shot, "rows", lambda *_: [])
    shot, trace = Shot(2.5, np.eye(3)), SimpleNamespace(samples=Samples.concatenate([]), leaves=())
    footage: Any = Footage(SimpleNamespace(), ())
    leaves = [LeafRun("", "", f"leaf {i}", 1.0 * i, i + 1.0, "SUCCESS") for i in range(4)]
    camera, planned = lambda: ask("the camera", footage), lambda: ask("the shot", shot)
    with Reel(camera, planned) as reel:
        for ended in range(2, 5):
            reel.look(trace.samples, leaves[:ended])
        assert (reel.finish(footage, trace) is None) == bool(fails)
        assert asked.count(fails) == bool(fails), "it is not tried again"
        assert Copy.open == (not fails)
    assert Copy.open == 0
