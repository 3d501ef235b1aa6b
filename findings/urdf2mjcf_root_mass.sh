#!/usr/bin/env bash
# urdf2mjcf does not read the mass of the first link, nor the damping and friction of joints.
#
# Packages: urdf2mjcf==0.2.39 mujoco==4.0.0 numpy==2.4.6.
# Expected: The converted model has the stated inertials and joint dynamics, as MuJoCo itself reads them from the URDF.
# Happens: The first link has no <inertial> in the MJCF. MuJoCo then computes its mass from the shapes, at the density of
# water, and counts the visual shape, too: a stated 5 kg becomes 2 kg. Other links keep theirs. A stated damping of
# 0.7 N m s/rad and a friction of 0.4 N m become 0. No message says so; one does for products of inertia.
# Why it matters: The first link is the base of a mobile or legged robot, often its heaviest part. Joints without their
# friction coast.
# Source: urdf2mjcf writes the inertial where it handles the child links of joints, and takes joint parameters from a
# file of metadata only.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet urdf2mjcf==0.2.39 mujoco==4.0.0 numpy==2.4.6
cd "$folder"
cat > arm.urdf <<'URDF'
<robot name="arm">
  <link name="base">
    <inertial><origin xyz="0 0 0"/><mass value="5"/>
      <inertia ixx=".02" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size=".1 .1 .1"/></geometry></visual>
    <collision><geometry><box size=".1 .1 .1"/></geometry></collision></link>
  <link name="lever">
    <inertial><origin xyz=".1 0 0"/><mass value="1.5"/>
      <inertia ixx=".01" iyy=".02" izz=".025" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="hinge" type="revolute"><parent link="base"/><child link="lever"/><origin xyz="0 0 .1"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="20" velocity="2"/>
    <dynamics damping=".7" friction=".4"/></joint>
</robot>
URDF
"$folder/venv/bin/urdf2mjcf" arm.urdf --output arm.xml > log.txt 2>&1
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

import mujoco

spec = mujoco.MjSpec.from_file("arm.urdf")
spec.compiler.fusestatic = False
stated, converted = spec.compile(), mujoco.MjModel.from_xml_path("arm.xml")
print("urdf2mjcf", version("urdf2mjcf"), "mujoco", version("mujoco"))
found = []
for name, model in (("MuJoCo's own reader", stated), ("urdf2mjcf", converted)):
    dof = int(model.joint("hinge").dofadr[0])
    masses = [round(float(model.body(body).mass[0]), 3) for body in ("base", "lever")]
    found.append((*masses, model.dof_damping[dof], model.dof_frictionloss[dof]))
    print(f"{name}: base {masses[0]} kg, lever {masses[1]} kg, damping {found[-1][2]}, friction {found[-1][3]}")
assert found == [(5.0, 1.5, 0.7, 0.4), (2.0, 1.5, 0.0, 0.0)]
log = Path("log.txt").read_text().lower()
assert not any(word in log for word in ("mass", "damping", "friction"))
PYTHON
