#!/usr/bin/env bash
# Pinocchio shifts the range of an MJCF joint by its `ref`, but not the joint's coordinate.
#
# Packages: pin==4.1.0 mujoco==4.0.0 numpy==2.4.6.
# Expected: Either the coordinate keeps MuJoCo's zero and the range stays, or zero moves to the initial pose and the
# range moves with it.
# Happens: The pose at each q equals MuJoCo's, and the limits are [-75, 15] degrees for a range of [-45, 45] with
# ref 30. The initial position 30 lies outside its own limits.
# Why it matters: A planner with these limits refuses half of the robot's range and accepts joint angles beyond the
# real stop.
# Source: pinocchio/parsers/mjcf, mjcf-graph.cpp: the reading of a joint subtracts the reference position from both
# limits. Its coordinate is not shifted, as the poses show.
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
import numpy as np
import pinocchio

ARM = """<mujoco model="arm"><worldbody><body name="link" pos="0 0 1">
<joint name="hinge" axis="0 1 0" range="-45 45" ref="30"/>
<inertial pos="0 0 .1" mass="1" diaginertia=".01 .01 .01"/></body></worldbody></mujoco>"""
with open("arm.xml", "w") as file:
    file.write(ARM)
model = mujoco.MjModel.from_xml_path("arm.xml")
data = mujoco.MjData(model)
pin_model = pinocchio.buildModelFromMJCF("arm.xml")
pin_data = pin_model.createData()

print("pin", version("pin"), "mujoco", version("mujoco"))
for angle in np.radians([0, 30, 45]):
    data.qpos[0] = angle
    mujoco.mj_forward(model, data)
    pinocchio.forwardKinematics(pin_model, pin_data, np.array([angle]))
    place = pin_data.oMi[1].act(pin_model.inertias[1].lever)
    print(
        f"q {np.degrees(angle):3.0f}: com {data.xipos[1].round(4)} mujoco, {place.round(4)} pinocchio"
    )
    assert np.allclose(place, data.xipos[1], atol=1e-4)
theirs = np.degrees([pin_model.lowerPositionLimit[0], pin_model.upperPositionLimit[0]])
ours = np.degrees(model.jnt_range[0])
start = np.degrees(pin_model.referenceConfigurations["qpos0"][0])
print(f"limits: {ours.round(2)} mujoco, {theirs.round(2)} pinocchio, initial position {start:.2f}")
assert np.allclose(ours, [-45, 45])
assert np.allclose(theirs, [-75, 15], atol=1e-3)
assert start > theirs[1] + 10
PYTHON
