#!/usr/bin/env bash
# An open box of 0.23 litres of material weighs 1.47 kg at density 1000: more than its convex hull.
#
# Packages: mujoco==4.0.0 numpy==2.4.6.
# Expected: Mass from a closed, well-oriented mesh is its volume times density. At worst the hull is used, which
# bounds it from above.
# Happens: The default algorithm sums volumes of pyramids without their signs. The cup gets 6.4 times its mass, 1.5
# times that of its hull. With the mass given, its inertia is 38 % too low.
# Why it matters: Cups, bowls and trays from scans and CAD get the wrong mass without a warning. `inertia="exact"`
# mends it.
# Source: MuJoCo's XML reference, mesh/inertia: the default "legacy" overcounts the volume of non-convex meshes and
# is kept for compatibility.
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

SCENE = """<mujoco><asset><mesh name="cup" vertex="{vertices}" face="{faces}" {inertia}/></asset>
<worldbody><body><geom type="mesh" mesh="cup" {mass}/></body></worldbody></mujoco>"""


def corners(half: float, low: float, high: float) -> list[tuple[float, float, float]]:
    """Return the 8 corners of a box: 4 below, 4 above, counter-clockwise."""
    square = ((-half, -half), (half, -half), (half, half), (-half, half))
    return [(x, y, z) for z in (low, high) for x, y in square]


vertices = np.array(corners(0.05, 0.0, 0.1) + corners(0.045, 0.005, 0.1))
quads = [(0, 3, 2, 1), (8, 9, 10, 11)]
for i in range(4):
    j = (i + 1) % 4
    quads += [(i, j, j + 4, i + 4), (j + 8, i + 8, i + 12, j + 12), (i + 4, j + 4, j + 12, i + 12)]
faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
volume = sum(np.dot(a, np.cross(b, c)) for a, b, c in vertices[faces]) / 6


def weigh(inertia: str, mass: str) -> tuple[float, float]:
    """Return the mass, kg, and the largest principal moment of inertia, kg m^2."""
    model = mujoco.MjModel.from_xml_string(
        SCENE.format(
            vertices=" ".join(map(str, vertices.ravel())),
            faces=" ".join(map(str, faces.ravel())),
            inertia=inertia,
            mass=mass,
        )
    )
    return model.body_mass[1], model.body_inertia[1].max()


print("mujoco", version("mujoco"))
usual, exact, hull = (weigh(i, "")[0] for i in ("", 'inertia="exact"', 'inertia="convex"'))
print(f"volume x density: {1000 * volume:.4f} kg")
print(f"mass: {usual:.4f} kg by default, {exact:.4f} kg exact, {hull:.4f} kg of the hull")
turn = [weigh(i, 'mass="1"')[1] for i in ("", 'inertia="exact"')]
print(f"largest inertia at mass 1: {turn[0]:.6f} by default, {turn[1]:.6f} exact, kg m^2")
assert abs(exact - 1000 * volume) < 1e-6
assert usual > 6 * exact
assert usual > hull
assert turn[0] < 0.65 * turn[1]
PYTHON
