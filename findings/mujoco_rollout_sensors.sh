#!/usr/bin/env bash
# Sensors of a MuJoCo rollout are one step older than the states beside them.
#
# Packages: mujoco==4.0.0 numpy==2.4.6.
# Expected: `rollout` returns arrays of states and of sensors with one row a step: row i of both is of the same time.
# Happens: A sensor of a joint's angle has in row i the angle of the state in row i - 1, and in row 0 that of the initial
# state. The clock of the state in row 0 is already one step. So the last state has no sensors.
# Why it matters: A fit of a simulation to a recording, which has angles and sensors of one time, gets a delay of a step.
# At 2 ms and 2 rad/s that is 4 mrad.
# Source: mj_step computes sensors before it integrates; rollout.cc copies both after the step.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import mujoco
import numpy as np
from mujoco import rollout

SCENE = """<mujoco><worldbody><body><joint name="hinge" axis="0 1 0"/>
<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body></worldbody>
<sensor><jointpos joint="hinge"/></sensor></mujoco>"""

model = mujoco.MjModel.from_xml_string(SCENE)
data = mujoco.MjData(model)
data.qvel[:] = 2.0
mujoco.mj_forward(model, data)
kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
start = np.zeros(mujoco.mj_stateSize(model, kind))
mujoco.mj_getState(model, data, start, kind)
states, sensors = rollout.rollout(model, data, start[None], nstep=4)

time, angle, sensed = states[0, :, 0], states[0, :, 1], sensors[0, :, 0]
print("mujoco", version("mujoco"))
for i in range(4):
    print(f"row {i}: time {time[i]:.3f} s, angle of the state {angle[i]:.6f}, of the sensor {sensed[i]:.6f} rad")
assert sensed[0] == start[1]
assert np.array_equal(sensed[1:], angle[:-1])
assert np.isclose(time[0], model.opt.timestep)
PYTHON
