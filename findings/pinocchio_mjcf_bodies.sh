#!/usr/bin/env bash
# Pinocchio reads the first body of an MJCF scene, and no mass of a geom that does not collide.
#
# Packages: pin==4.1.0 mujoco==4.0.0 numpy==2.4.6.
# Expected: A reader builds the whole tree, or names what it leaves out.
# Happens: Of a table, a door and a free cup, the table is read: no joint, no mass. If the door stands first it is
# read, without the mass of its handle, whose geom has contype 0. There is no message.
# Why it matters: Scenes have many bodies below the world, and mass on non-colliding geoms is usual in published
# robot models. Gravity compensation is then silently too weak.
# Source: pinocchio/parsers/mjcf, mjcf-graph.cpp: the inertia of a body sums its geoms except those of kind VISUAL,
# which are those with contype 0 and conaffinity 0. The graph has one root body.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0 mujoco==4.0.0 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import mujoco
import pinocchio

TABLE = '<body name="table"><geom type="box" size=".5 .5 .02" mass="9"/></body>'
DOOR = """<body name="door" pos="0 0 1"><joint name="hinge" axis="0 0 1"/>
<geom type="box" size=".2 .02 .4" mass="5"/>
<geom type="sphere" size=".03" mass=".7" contype="0" conaffinity="0"/></body>"""
CUP = '<body name="cup" pos="1 0 1"><freejoint/><geom type="sphere" size=".05" mass=".25"/></body>'


def compare(*bodies: str) -> tuple[int, float, int, float]:
    """Return nq and mass, kg, in MuJoCo, then in pinocchio."""
    with open("scene.xml", "w") as file:
        file.write(f'<mujoco model="scene"><worldbody>{"".join(bodies)}</worldbody></mujoco>')
    ours = mujoco.MjModel.from_xml_path("scene.xml")
    theirs = pinocchio.buildModelFromMJCF("scene.xml")
    mass = sum(inertia.mass for inertia in list(theirs.inertias)[1:])
    return ours.nq, float(ours.body_mass.sum()), theirs.nq, mass


print("pin", version("pin"), "mujoco", version("mujoco"))
first_table, first_door = compare(TABLE, DOOR, CUP), compare(DOOR, TABLE, CUP)
for order, (nq, mass, pin_nq, pin_mass) in (("table", first_table), ("door", first_door)):
    print(f"{order} first: mujoco nq {nq}, {mass:.2f} kg; pinocchio nq {pin_nq}, {pin_mass:.2f} kg")
assert first_table[0] == first_door[0] == 8
assert first_table[2:] == (0, 0)
assert first_door[2] == 1
assert abs(first_door[3] - 5.0) < 1e-6
PYTHON
