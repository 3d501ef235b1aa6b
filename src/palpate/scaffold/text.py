"""The files of a new scene: MJCF and poses.yaml with a comment wherever a person has to decide."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from palpate.scaffold.things import Thing

_HEAD = """\
<!-- A scene for palpate. Lengths in m, masses in kg; x points away from the arm's foot, y to its left, z up.
     What you know, write down. What you do not know, leave out or write as "?": that is what is measured. -->
<mujoco model="{model}">
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".86 .91 .96" rgb2=".55 .66 .78" width="64" height="384"/>
  </asset>

  <worldbody>
    <light pos="0.4 -0.6 1.9" dir="0 0.2 -1" diffuse=".8 .8 .8"/>
    <camera name="workspace" pos="1.35 -1.05 0.95" xyaxes="0.65 0.76 0 -0.38 0.33 0.86" fovy="42"/>

    <!-- Where the arm's foot is. Everything below is measured from here. -->
    <site name="robot_base" pos="0 0 0"/>

    <!-- The middle of a slab of 1.2 x 1.2 x 0.04 m, whose top is level with the arm's foot. If you do not know how
         high your {surface} is, write pos="0.35 0 ?". -->
    <body name="{surface}" pos="0.35 0 -0.02">
      <geom type="box" size=".60 .60 .02" rgba=".88 .80 .66 1"/>
    </body>
"""

_THING = """
    <!-- {about} -->
    <body name="{name}" pos="{x:g} {y:g} {z:.4g}">
      <freejoint/>
      <geom type="{shape}" size="{size}" rgba="{colour} 1"/>
    </body>
"""

_FOOT = """\
  </worldbody>
</mujoco>
"""

_SIZES = {
    "box": "half its extents along x, y and z",
    "cylinder": "its radius and half its height",
    "sphere": "its radius",
}

_POSES = """\
# Where things are, where the MJCF does not say it well enough. Every entry is optional: remove the '#'
# of what you need. Lengths in m, angles in rad, z up. `palpate teach scene.xml` fills this in with you.

# objects:                      # poses of the objects' frames in the world; they overrule the MJCF
#   {first}: {{pos: [0.42, 0.0, 0.05], yaw: 0.3}}

# accuracy: 0.002               # how well these are known (1 sigma)

# places:                       # poses of the point between the fingertips, which point down
#   shelf_approach: {{pos: [0.4, 0.3, 0.3]}}

# grasps:                       # where the hand takes an object, in the object's own frame
#   {first}: {{pos: [0.0, 0.0, 0.01], yaw: 1.57}}

# offsets:                      # how far a plan goes: up before and after a grasp, aside for a second one
#   z_offset: 0.12
"""


def scene_text(model: str, surface: str, things: Sequence[Thing]) -> str:
    """The MJCF of a table and what stands on it, with nothing's mass stated."""
    head = _HEAD.format(model=model, surface=surface)
    return head + "".join(_bodies(things)) + _FOOT


def poses_text(things: Sequence[Thing]) -> str:
    """A poses.yaml in which everything is a comment."""
    first = things[0].name if things else "mug"
    return _POSES.format(first=first)


def _bodies(things: Sequence[Thing]) -> Iterator[str]:
    for thing in things:
        yield _THING.format(
            about=_about(thing),
            name=thing.name,
            x=thing.x,
            y=thing.y,
            z=thing.height / 2,
            shape=thing.shape,
            size=thing.size,
            colour=thing.colour,
        )


def _about(thing: Thing) -> str:
    """Hints for what a person should correct."""
    guess = f"A {thing.kind} of common size" if thing.kind else "A box, for want of a better guess"
    return f"{guess}: size is {_SIZES[thing.shape]}. Neither mass nor friction: missing."
