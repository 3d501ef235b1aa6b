#!/usr/bin/env bash
# A wrist force sensor does not feel the drag of the water that the motor must overcome.
#
# Packages: mujoco==4.0.0 numpy==2.4.6.
# Expected: A force sensor between arm and paddle reads the drag on the paddle: the motor pushes it through that
# cut.
# Happens: In steady motion through water the motor pushes with 4.9 N and the sensor reads 0.000 N. A tendon's pull
# of 12 N is read in full.
# Why it matters: A simulated force-torque sensor cannot be used to identify drag, viscosity or added mass, nor to
# test code that does. Nothing warns.
# Source: MuJoCo's documentation of the force sensor says that all forces on the system are taken into account. The
# function reference, `mj_rnePostConstraint`, adds that fluid forces, gravity compensation and actuators with site
# transmission are not collected yet.
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

SCENE = """<mujoco><option timestep=".001" density="{density}" integrator="implicitfast"/>
<worldbody><site name="anchor" pos="3 0 1"/>
<body pos="0 0 1"><joint name="rail" type="slide" axis="1 0 0"/><geom type="sphere" size=".001" mass="1"/>
<body><site name="wrist"/><geom type="box" size=".05 .1 .1" mass=".5"/></body></body></worldbody>
<tendon>{tendon}</tendon>
<actuator><velocity joint="rail" kv="1000"/></actuator>
<sensor><force site="wrist"/></sensor></mujoco>"""
TENDON = (
    '<spatial stiffness="4" springlength="0"><site site="wrist"/><site site="anchor"/></spatial>'
)


def read(density: float, tendon: str, speed: float) -> tuple[float, float]:
    """Return the motor's force and the sensor's force along the rail, N, after 1 s."""
    model = mujoco.MjModel.from_xml_string(SCENE.format(density=density, tendon=tendon))
    data = mujoco.MjData(model)
    data.ctrl[0] = speed
    for _ in range(1000):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    assert abs(data.qacc[0]) < 1e-2  # steady motion: no inertial force
    return data.qfrc_actuator[0], data.sensordata[0]


print("mujoco", version("mujoco"))
drag = read(1000.0, "", 0.5)
pull = read(0.0, TENDON, 0.0)
print(f"water: motor {drag[0]:.3f} N, wrist sensor {drag[1]:.3f} N")
print(f"tendon: motor {pull[0]:.3f} N, wrist sensor {pull[1]:.3f} N")
assert drag[0] > 4
assert abs(drag[1]) < 0.02
assert abs(pull[0]) > 10
assert abs(pull[1] - pull[0]) < 0.05
PYTHON
