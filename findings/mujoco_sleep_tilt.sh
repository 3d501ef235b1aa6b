#!/usr/bin/env bash
# A sleeping box stays on a table that is tilted by 63 degrees, even without friction.
#
# Packages: mujoco==4.0.0 numpy==2.4.6.
# Expected: A body at rest wakes as soon as the forces on it change: gravity that tilts (a tilt table) makes it
# slide.
# Happens: With the sleep flag, a change of gravity or of a geom's friction wakes nothing. The box rests at friction
# 0 on a slope of 63 degrees. The same run without the flag slides several metres.
# Why it matters: A friction experiment by tilting, or a change of friction for domain randomisation, reports a body
# that never slips. Speed is the reason to enable sleep, and the result then differs.
# Source: MuJoCo's documentation, sleeping islands: contact with an awake tree and manual waking are the triggers.
# Contacts of a sleeping island with static bodies are skipped.
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

SCENE = """<mujoco><option><flag sleep="{sleep}"/></option><worldbody>
<geom name="table" type="plane" size="20 20 .1"/>
<body pos="0 0 .05"><freejoint/><geom name="box" type="box" size=".05 .05 .05"/></body>
</worldbody></mujoco>"""


def tilt(sleep: str) -> float:
    """Return how far the box has moved, m, 1 s after the tilt and the loss of friction."""
    model = mujoco.MjModel.from_xml_string(SCENE.format(sleep=sleep))
    data = mujoco.MjData(model)
    for _ in range(2000):
        mujoco.mj_step(model, data)
    model.opt.gravity[:] = 2 * 9.81, 0, -9.81
    model.geom_friction[:, 0] = 0
    start = data.qpos[0]
    for _ in range(500):
        mujoco.mj_step(model, data)
    return data.qpos[0] - start


print("mujoco", version("mujoco"))
asleep, awake = tilt("enable"), tilt("disable")
print(f"moved in 1 s: {asleep:.6f} m with the sleep flag, {awake:.3f} m without")
assert asleep == 0
assert awake > 5
PYTHON
