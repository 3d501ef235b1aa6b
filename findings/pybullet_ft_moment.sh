#!/usr/bin/env bash
# pybullet's joint force-torque sensor reports the moment about the child's centre of mass.
#
# Packages: pybullet==3.2.7 numpy==2.4.6.
# Expected: A sensor in a fixed joint carries a tool of 2 kg with its centre of mass 0.2 m away: it reads 19.6 N and
# 3.92 N m.
# Happens: It reads 19.6 N and 0 N m. A second link behind the first one enters with its lever to the first link's
# centre of mass, not to the joint.
# Why it matters: Mass and centre of mass of a payload are identified from force and moment. With this sensor the
# centre of mass of a single tool is always found at zero.
# Source: Bullet, btMultiBody: the joint feedback is filled while the recursion works in link frames, whose origin
# is the link's centre of mass. The guide only says joint reaction forces.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import pybullet

LINK = """<link name="{name}"><inertial><origin xyz="{com} 0 0"/><mass value="{mass}"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{child}" type="fixed"><origin xyz="{x} 0 0"/>
<parent link="{parent}"/><child link="{child}"/></joint>"""
TOOL = LINK.format(name="base", com=0, mass=1) + LINK.format(name="tool", com=0.2, mass=2)
TOOL += JOINT.format(parent="base", child="tool", x=0.5)
CUP = LINK.format(name="cup", com=0.1, mass=1) + JOINT.format(parent="tool", child="cup", x=0.3)


def read(name: str, body: str) -> np.ndarray:
    """Return force, N, and moment, N m, in the first joint at rest."""
    with open(name, "w") as file:
        file.write(f'<robot name="r">{body}</robot>')
    robot = pybullet.loadURDF(name, useFixedBase=True)
    pybullet.enableJointForceTorqueSensor(robot, 0, True)
    for _ in range(240):
        pybullet.stepSimulation()
    return np.array(pybullet.getJointState(robot, 0)[2])


print("pybullet", version("pybullet"))
pybullet.connect(pybullet.DIRECT)
pybullet.setGravity(0, 0, -9.81)
for name, body, at_joint, at_com in (
    ("tool.urdf", TOOL, 2 * 9.81 * 0.2, 0.0),
    ("tool_cup.urdf", TOOL + CUP, 2 * 9.81 * 0.2 + 9.81 * 0.4, 9.81 * 0.2),
):
    wrench = read(name, body)
    print(
        f"{name}: force {wrench[2]:.2f} N, moment {abs(wrench[4]):.3f} N m;"
        f" about the joint {at_joint:.3f}, about the tool's com {at_com:.3f}"
    )
    assert abs(abs(wrench[4]) - at_com) < 1e-3
    assert wrench[2] > 19
PYTHON
