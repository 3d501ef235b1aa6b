#!/usr/bin/env bash
# An object that obj2mjcf makes weighs twice as much as its mesh.
#
# Packages: obj2mjcf==0.0.25 mujoco==4.0.0 numpy==2.4.6.
# Expected: A cube of 0.1 m gets the mass of its volume, 1 kg at MuJoCo's density of water: the visual geom is for looks.
# Happens: The body has the mesh twice, as visual and as collision geom. The class of visual geoms switches contacts off
# but not the mass, so that the compiled body weighs 2 kg, with twice the inertia. A convex decomposition in place of
# the second mesh adds the mass of its parts in the same way.
# Why it matters: Masses, and every force that depends on them, are wrong by a factor of two for an import that looks and
# collides as it should. `mass="0"` in the class of visual geoms mends it.
# Source: obj2mjcf writes the defaults of both classes without mass or density; MuJoCo counts every geom of a body.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet obj2mjcf==0.0.25 mujoco==4.0.0 numpy==2.4.6
mkdir "$folder/objs"
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from itertools import product
from pathlib import Path

corners = product((-0.05, 0.05), repeat=3)
faces = ("1 2 4", "1 4 3", "5 7 8", "5 8 6", "1 5 6", "1 6 2", "3 4 8", "3 8 7", "1 3 7", "1 7 5", "2 6 8", "2 8 4")
lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {face}" for face in faces]
Path("objs/cube.obj").write_text("\n".join(lines) + "\n")
PYTHON
"$folder/venv/bin/obj2mjcf" --obj-dir objs --save-mjcf > /dev/null
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

import mujoco

WATER, SIDE = 1000.0, 0.1
file = Path("objs/cube/cube.xml")
model = mujoco.MjModel.from_xml_path(str(file))
mended = file.with_name("mended.xml")
mended.write_text(file.read_text().replace('contype="0"', 'contype="0" mass="0"'))
without = mujoco.MjModel.from_xml_path(str(mended))
cube = WATER * SIDE**3
print("obj2mjcf", version("obj2mjcf"), "mujoco", version("mujoco"))
print(f"cube: {cube:.3f} kg, {cube * SIDE**2 / 6:.5f} kg m2")
for name, found in (("as written", model), ("visual geoms without mass", without)):
    print(f"{name}: {found.body('cube').mass[0]:.3f} kg, {found.body('cube').inertia[0]:.5f} kg m2")
assert abs(model.body("cube").mass[0] - 2 * cube) < 1e-6
assert abs(without.body("cube").mass[0] - cube) < 1e-6
PYTHON
