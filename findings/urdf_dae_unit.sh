#!/usr/bin/env bash
# A COLLADA mesh in millimetres, in one URDF: 0.1 m in PyBullet, 100 m in pinocchio and yourdfpy.
#
# Packages: pin==4.1.0 pybullet==3.2.7 yourdfpy==0.0.60 trimesh==5.2.0 pycollada==0.9.3 numpy.
# Expected: a DAE file states its unit (`<unit meter="0.001"/>`), so every reader gets metres. Other mesh formats have
# no unit, which is why URDF has `scale`.
# Happens: PyBullet scales by the unit. Pinocchio does not. trimesh reads the unit into `units` and leaves the numbers,
# and yourdfpy takes these as metres. Nothing warns.
# Why it matters: CAD programs export millimetres. A `scale` of 0.001 in the URDF mends two readers and shrinks the mesh
# in the third. Collision checks and masses from volumes are off by 10^3 and 10^9.
# Source: COLLADA 1.4.1, element `unit`; seen in these versions.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0 pybullet==3.2.7 yourdfpy==0.0.60 trimesh==5.2.0 pycollada==0.9.3
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pinocchio as pin
import pybullet
import trimesh
import yourdfpy

# A cube of 100 mm, in the unit of its file.
mesh = trimesh.creation.box((100, 100, 100)).export(file_type="dae").decode()
Path("cube.dae").write_text(mesh.replace("</asset>", '<unit name="millimeter" meter="0.001"/></asset>', 1))
shape = '<geometry><mesh filename="cube.dae"/></geometry>'
Path("cube.urdf").write_text(
    '<robot name="cube"><link name="cube"><inertial><mass value="1"/>'
    '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
    f"<visual>{shape}</visual><collision>{shape}</collision></link></robot>"
)

sides = {}
pybullet.connect(pybullet.DIRECT)
low, high = pybullet.getAABB(pybullet.loadURDF("cube.urdf"))
sides["pybullet"] = high[0] - low[0]
geometry = pin.buildGeomFromUrdf(pin.buildModelFromUrdf("cube.urdf"), "cube.urdf", pin.GeometryType.COLLISION, ["."])
cube = geometry.geometryObjects[0].geometry
cube.computeLocalAABB()
sides["pin"] = float(np.ptp([cube.aabb_local.min_, cube.aabb_local.max_], axis=0)[0])
sides["yourdfpy"] = float(yourdfpy.URDF.load("cube.urdf").scene.extents[0])
print("trimesh", version("trimesh"), "unit of the file:", trimesh.load("cube.dae").units)
for name, side in sides.items():
    print(name, version(name), f"side {side:.3g} m")
assert abs(sides["pybullet"] - 0.1) < 0.01  # with its collision margin
assert abs(sides["pin"] - 100) < 1e-6 and abs(sides["yourdfpy"] - 100) < 1e-6
PYTHON
# Output, 2026-11-28:
# trimesh 5.2.0 unit of the file: 0.001 * meters
# pybullet 3.2.7 side 0.104 m
# pin 4.1.0 side 100 m
# yourdfpy 0.0.60 side 100 m
