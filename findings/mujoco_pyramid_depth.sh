#!/usr/bin/env bash
# A ball on a table sinks 116 times less deep when only its friction changes, if the cone is pyramidal.
#
# Packages: mujoco==4.0.0 numpy==2.4.6.
# Expected: `solref` and `solimp` of a contact, and the load, determine how deep a resting body sinks. Friction,
# `condim` and `impratio` act along the surface.
# Happens: With elliptic cones that is so. With pyramidal cones, the default, the normal stiffness rises with
# condim, with impratio and with the inverse square of the friction coefficient.
# Why it matters: Contact stiffness identified in one scene is wrong after the friction, the cone or impratio of the
# scene changes. Whoever randomises friction also randomises stiffness.
# Source: MuJoCo's XML reference, option/impratio: the pyramidal basis vectors mix normal and frictional directions.
# It advises against a high impratio but names no effect on the depth.
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

SCENE = """<mujoco><option cone="{cone}" impratio="{impratio}"/>
<default><geom friction="{friction}" condim="{condim}" solref="-1000 -100"/></default>
<worldbody><geom type="plane" size="1 1 .1"/>
<body pos="0 0 .05"><freejoint/><geom type="sphere" size=".05" mass="1"/></body></worldbody></mujoco>"""


def measure_depth(cone: str, friction: float, condim: int, impratio: float) -> float:
    """Return the depth, mm, at which a ball of 1 kg rests after 8 s."""
    model = mujoco.MjModel.from_xml_string(
        SCENE.format(cone=cone, friction=friction, condim=condim, impratio=impratio)
    )
    data = mujoco.MjData(model)
    for _ in range(4000):
        mujoco.mj_step(model, data)
    return 1e3 * (0.05 - data.qpos[2])


print("mujoco", version("mujoco"))
depths = {}
for cone in ("elliptic", "pyramidal"):
    for case in ((1.0, 3, 1), (0.1, 3, 1), (1.0, 6, 1), (1.0, 3, 10)):
        depths[cone, case] = measure_depth(cone, *case)
        friction, condim, impratio = case
        print(
            f"{cone}: friction {friction}, condim {condim}, impratio {impratio}:"
            f" depth {depths[cone, case]:.4f} mm"
        )
usual = (1.0, 3, 1)
assert all(abs(depths["elliptic", c] - depths["elliptic", usual]) < 1e-3 for _, c in depths)
pyramidal = {case: depth for (cone, case), depth in depths.items() if cone == "pyramidal"}
assert abs(pyramidal[usual] - depths["elliptic", usual]) < 1e-3
assert pyramidal[usual] > 80 * pyramidal[0.1, 3, 1]
assert pyramidal[usual] > 1.5 * pyramidal[1.0, 6, 1]
assert pyramidal[usual] > 5 * pyramidal[1.0, 3, 10]
PYTHON
