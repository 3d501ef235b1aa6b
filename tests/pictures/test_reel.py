"""A film drawn while the arm moves is the one that would be drawn afterwards."""

from __future__ import annotations

import subprocess
import sys

import pytest

from palpate.pictures.renderer import gl_available

usable, reason = gl_available()

RUN = """
import os, signal
import mujoco
import numpy as np
from palpate.beside import can_copy
from palpate.pictures.film import Footage, Shot, film_of
from palpate.pictures.reel import Reel
from palpate.trace.recording import Hand, LeafRun
from palpate.trace.samples import Samples, Trace

BALL = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
  <body name="table" pos="0 0 0.5"><geom type="box" size=".3 .4 .02"/></body>
  <body name="ball" pos="0 0 .6"><freejoint/><geom size=".05" rgba="1 0 0 1"/></body>
</worldbody></mujoco>''')
HAND = Hand(0.009, 0.15, 0.01, 1e-4)
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
