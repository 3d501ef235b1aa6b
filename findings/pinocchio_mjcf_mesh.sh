#!/usr/bin/env bash
# Pinocchio gives every body whose shape is a mesh, in an MJCF file, a mass of 1 kg and an inertia of 1 kg m².
#
# Packages: pin==4.1.0 mujoco==4.0.0 numpy==2.4.6.
# Expected: the mass of a mesh geom is its `mass`, or density times volume, as for boxes, capsules and ellipsoids.
# Happens: it is 1 kg in the body's origin, with the identity as inertia, whatever `mass` or `density` says. A corner of
# 0.17 kg becomes 6 times as heavy; its inertia thousands of times as large. Nothing warns.
# Why it matters: published scenes have meshes and no `<inertial>`. Torques and predicted motions are those of other
# objects. `<inertial>` in the body is read correctly, and mends it.
# Source: XML reference of MuJoCo, `geom/mass`; seen in these versions.
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
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin

# A corner of a cube: a tetrahedron with three sides of 100 mm.
Path("corner.obj").write_text(
    "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
)
SCENE = """<mujoco><asset><mesh name="corner" file="corner.obj"/></asset><worldbody>
<body name="corner" pos="0 0 1"><freejoint/>{}</body></worldbody></mujoco>"""
BODIES = {
    "density of water": '<geom type="mesh" mesh="corner"/>',
    "mass 3": '<geom type="mesh" mesh="corner" mass="3"/>',
    "with inertial": '<inertial pos=".02 .02 .02" mass="3" diaginertia=".01 .01 .01"/>'
    '<geom type="mesh" mesh="corner"/>',
}
print("pinocchio", version("pin"), "mujoco", version("mujoco"))
read = {}
for name, content in BODIES.items():
    Path("scene.xml").write_text(SCENE.format(content))
    model = mujoco.MjModel.from_xml_path("scene.xml")
    body = pin.buildModelFromMJCF("scene.xml").inertias[1]
    read[name] = (body.mass, np.diag(body.inertia))
    print(f"{name}: mujoco {model.body_mass[1]:.4f} kg and {model.body_inertia[1].max():.1e} kg m^2,", end=" ")
    print(f"pinocchio {body.mass:.4f} kg and {body.inertia.max():.1e} kg m^2, middle at {body.lever.tolist()}")
for name in ("density of water", "mass 3"):
    assert read[name][0] == 1.0 and (read[name][1] == 1.0).all()
assert abs(read["with inertial"][0] - 3) < 1e-12
PYTHON
# Output, 2026-11-28:
# pinocchio 4.1.0 mujoco 4.0.0
# density of water: mujoco 0.1667 kg and 1.7e-04 kg m^2, pinocchio 1.0000 kg and 1.0e+00 kg m^2, middle at [0.0, 0.0, 0.0]
# mass 3: mujoco 3.0000 kg and 3.0e-03 kg m^2, pinocchio 1.0000 kg and 1.0e+00 kg m^2, middle at [0.0, 0.0, 0.0]
# with inertial: mujoco 3.0000 kg and 1.0e-02 kg m^2, pinocchio 3.0000 kg and 1.0e-02 kg m^2, middle at [0.02, 0.02, 0.02]
