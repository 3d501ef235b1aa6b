"""The MJCF of fitted shapes: what contact will tell is left open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from palpate.mjcf.edits import number
from palpate.scene.pictured.objects import Fitted
from palpate.scene.poses import Poses

THICKNESS = 0.02
"""m: of the slab that a plane becomes."""


def written(slabs: Sequence[Fitted], things: Sequence[Fitted], poses: Poses) -> str:
    """The template: shapes as fitted, heights `?`, masses and frictions left out. Names are checked
    where read."""
    camera = poses.camera
    assert camera is not None
    lines = [
        "<!-- Built from a picture: the shapes fill the boxes that a model saw in it. -->",
        '<mujoco model="from picture">',
        "  <worldbody>",
        '    <site name="robot_base"/>',
        f'    <camera name="workspace" pos="{_numbers(camera.pos)}" quat="{_numbers(camera.quat)}" '
        f'fovy="{number(camera.fovy)}"/>',
    ]
    for slab in slabs:
        lines += _slab_lines(slab)
    for thing in things:
        lines += _thing_lines(thing)
    lines += ["  </worldbody>", "</mujoco>"]
    return "\n".join(lines) + "\n"


def _slab_lines(slab: Fitted) -> Iterator[str]:
    size = _metres(slab.width / 2, slab.depth / 2, THICKNESS / 2)
    yield f'    <body name="{slab.thing.name}" pos="{_metres(slab.x, slab.y)} ?">'
    yield f'      <geom type="box" size="{size}" pos="0 0 {-THICKNESS / 2:g}"/>'
    yield "    </body>"


def _thing_lines(f: Fitted) -> Iterator[str]:
    size = (f.width / 2, f.depth / 2, f.height / 2)
    if f.thing.shape == "cylinder":
        size = (f.width / 2, f.height / 2)
    elif f.thing.shape == "sphere":
        size = (f.width / 2,)
    turned = f' euler="0 0 {np.degrees(f.yaw):.2f}"' if f.yaw else ""
    yield f'    <body name="{f.thing.name}" pos="{_metres(f.x, f.y)} ?"{turned}>'
    yield "      <freejoint/>"
    yield f'      <geom type="{f.thing.shape}" size="{_metres(*size)}"/>'
    yield "    </body>"


def _metres(*values: float) -> str:
    """To a tenth of a millimetre."""
    return " ".join(f"{v:.4f}" for v in values)


def _numbers(values: Sequence[float]) -> str:
    return " ".join(number(v) for v in values)
