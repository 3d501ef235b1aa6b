#!/usr/bin/env bash
# Pinocchio reads damping and dry friction of a URDF's joints, and its dynamics do not use them.
#
# Packages: pin==4.1.0 numpy==2.4.6.
# Expected: `<dynamics damping friction>` is read into the model, so `rnea` and `aba` contain both, as a
# simulator's dynamics do.
# Happens: the values are in `model.damping` and in the limits of dry friction. `rnea` and `aba` give the torque and the
# acceleration of a joint without losses. They do use `model.armature`, the third value of that kind. Nothing warns.
# Why it matters: a simulated door never comes to rest. A feed-forward torque, or a torque residual by which an arm
# looks for contacts, lacks the friction that the file states.
# Source: the algorithms' documentation names armature only; seen in 4.1.0.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import pinocchio as pin

DOOR = """<robot name="door"><link name="frame"/><link name="leaf"><inertial><origin xyz="0.4 0 0"/><mass value="5"/>
<inertia ixx="0.1" iyy="0.1" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="frame"/><child link="leaf"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="50" velocity="5"/><dynamics damping="0.8" friction="0.5"/></joint></robot>"""

model = pin.buildModelFromXML(DOOR)
data = model.createData()
q, at_2_rad_s, zero = np.zeros(1), np.array([2.0]), np.zeros(1)
torque = pin.rnea(model, data, q, at_2_rad_s, zero).item()
acceleration = pin.aba(model, data, q, at_2_rad_s, zero).item()
print("pinocchio", version("pin"))
print(f"read: damping {model.damping.item()} N m s/rad, dry friction {model.upperDryFrictionLimit.item()} N m")
print(f"torque that keeps 2 rad/s: {torque:g} N m ({0.8 * 2 + 0.5:g} by the file)")
print(f"acceleration at 2 rad/s without torque: {acceleration:g} rad/s^2 ({-2.1 / 1.0:g} by the file)")
assert model.damping.item() == 0.8 and model.upperDryFrictionLimit.item() == 0.5
assert abs(torque) < 1e-12 and abs(acceleration) < 1e-12
model.armature[:] = 0.25
with_armature = pin.rnea(model, data, q, zero, np.ones(1)).item()
print(f"torque for 1 rad/s^2 with an armature of 0.25 kg m^2: {with_armature:g} N m")
assert abs(with_armature - 1.25) < 1e-9
PYTHON
# Output, 2026-11-28:
# pinocchio 4.1.0
# read: damping 0.8 N m s/rad, dry friction 0.5 N m
# torque that keeps 2 rad/s: 0 N m (2.1 by the file)
# acceleration at 2 rad/s without torque: 0 rad/s^2 (-2.1 by the file)
# torque for 1 rad/s^2 with an armature of 0.25 kg m^2: 1.25 N m
