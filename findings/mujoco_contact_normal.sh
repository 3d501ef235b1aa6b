#!/usr/bin/env bash
# MuJoCo turns the normal of a shallow contact over: the contact pulls.
#
# Packages: mujoco==4.0.0.
# Expected: The normal of a contact points out of the box, however shallow the contact is.
# Happens: A tilted cylinder or ellipsoid enters the top of a box by 1e-10 to 1e-6 m. In about half of the poses whose
# depth is below a fifth of ccd_tolerance (default 1e-6 m), the normal points into the box. With ccd_tolerance 1e-12
# no normal is turned over: 185 of 400 against 0 for the cylinder, 124 against 0 for the ellipsoid.
# Why it matters: A cup that slides under 5 N with friction 0.7 enters its support by as little as that. One physics
# step in ten pulled it down with 4 N.
# Source: MuJoCo's XML reference, option/ccd_tolerance: the threshold at which the convex collision algorithm stops.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0
"$folder/venv/bin/python" - <<'PYTHON'
import mujoco
import numpy as np

SCENE = """<mujoco><option ccd_tolerance="{}"/><worldbody>
<geom type="box" size=".4 .5 .02" pos=".6 0 -.02"/>
<body><freejoint/><geom type="{}" size="{}"/></body></worldbody></mujoco>"""


def count_turned(tolerance: float, shape: str, size: str) -> int:
    """Count the poses, of 400, with a normal that points into the box."""
    model = mujoco.MjModel.from_xml_string(SCENE.format(tolerance, shape, size))
    data, random, turned = mujoco.MjData(model), np.random.default_rng(0), 0
    for depth in np.geomspace(1e-10, 1e-6, 400):
        quaternion = np.array([1.0, *random.uniform(-0.005, 0.005, 2), 0.0])
        quaternion /= np.linalg.norm(quaternion)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, quaternion)
        down = turn[6:]
        # Height of the centre over the lowest point of the shape.
        height = 0.03 * np.hypot(down[0], down[1]) + 0.045 * down[2]
        if shape == "ellipsoid":
            height = np.linalg.norm(down * [0.03, 0.03, 0.045])
        data.qpos[:3] = *random.uniform((0.4, -0.2), (0.6, 0.2)), height - depth
        data.qpos[3:] = quaternion
        mujoco.mj_fwdPosition(model, data)
        # The normal points from the first geom to the second; the box is geom 0.
        turned += any((c.frame[2] > 0) != (c.geom[0] == 0) for c in data.contact)
    return turned


changed = False
for shape, size in (("cylinder", ".03 .045"), ("ellipsoid", ".03 .03 .045")):
    usual, fine = (count_turned(tolerance, shape, size) for tolerance in (1e-6, 1e-12))
    print(f"{shape}: {usual} of 400 normals turned over at ccd_tolerance 1e-06, {fine} at 1e-12")
    changed |= usual < 50 or fine > 0
raise SystemExit(changed)
PYTHON
