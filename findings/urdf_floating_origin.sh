#!/usr/bin/env bash
# Three readers of one URDF give a free body three states: free at 2 m, free at 0 m, and welded.
#
# Packages: mujoco==4.0.0 pybullet==3.2.7 newton==1.8.0 warp-lang==1.19.0 numpy==2.4.6.
# Expected: A joint of type "floating" has an origin, and the body starts there: 2 m over the floor.
# Happens: MuJoCo starts the body at 2 m, free. Newton starts it at the origin. pybullet holds it at 2 m for ever.
# Why it matters: Free objects of a scene start inside the floor or table and are thrown out of it, or hang in the
# air. A URDF cannot carry the pose of a free object between simulators.
# Source: The URDF specification of joint lists the type floating and the origin of every joint. pybullet prints
# that it makes a fixed joint instead.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 pybullet==3.2.7 newton==1.8.0 warp-lang==1.19.0 numpy==2.4.6
cd "$folder"
export WARP_CACHE_PATH="$folder/kernels"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import mujoco
import numpy as np
import pybullet
import warp as wp

wp.config.quiet = True
import newton  # noqa: E402

ROBOT = """<robot name="scene"><link name="world"/>
<link name="cup"><inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><sphere radius=".05"/></geometry></collision></link>
<joint name="free" type="floating"><origin xyz="0 0 2"/><parent link="world"/><child link="cup"/></joint></robot>"""
with open("scene.urdf", "w") as file:
    file.write(ROBOT)

model = mujoco.MjModel.from_xml_path("scene.urdf")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
mujoco_start = data.body("cup").xpos[2]
mujoco.mj_step(model, data, nstep=100)
mujoco_falls = data.body("cup").xpos[2] < mujoco_start - 0.1

pybullet.connect(pybullet.DIRECT)
pybullet.setGravity(0, 0, -9.81)
robot = pybullet.loadURDF("scene.urdf", useFixedBase=True)
for _ in range(240):
    pybullet.stepSimulation()
bullet_end = pybullet.getLinkState(robot, 0, computeForwardKinematics=True)[0][2]

builder = newton.ModelBuilder()
builder.add_urdf("scene.urdf")
newton_model = builder.finalize(device="cpu")
state = newton_model.state()
newton.eval_fk(newton_model, newton_model.joint_q, newton_model.joint_qd, state)
newton_start = state.body_q.numpy()[builder.body_label.index("scene/cup"), 2]

for name in ("mujoco", "pybullet", "newton"):
    print(name, version(name))
print(f"mujoco: starts at {mujoco_start:.3f} m, falls: {mujoco_falls}")
print(f"pybullet: at {bullet_end:.3f} m after 1 s")
print(f"newton: starts at {newton_start:.3f} m")
assert np.isclose(mujoco_start, 2)
assert mujoco_falls
assert np.isclose(bullet_end, 2)
assert abs(newton_start) < 1e-5
PYTHON
