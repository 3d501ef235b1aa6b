#!/usr/bin/env bash
# pybullet loads the first version of a URDF file again after the file has changed.
#
# Packages: pybullet==3.2.7 numpy==2.4.6.
# Expected: `loadURDF` reads the file.
# Happens: The content is cached by file name. A link rewritten with 1, 2, then 3 kg has 1 kg each time, in the same
# process. Another file name, or `setPhysicsEngineParameter(enableFileCaching=0)`, gives the new mass.
# Why it matters: An identification loop writes a parameter, loads and simulates. Its cost does not depend on the
# parameter, and a sensitivity of zero looks like an unobservable quantity.
# Source: Bullet's PyBullet quickstart guide, setPhysicsEngineParameter: enableFileCaching is described for mesh
# files; the same cache serves the URDF text.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import pybullet

LINK = """<robot name="tool"><link name="tool"><inertial><mass value="{mass}"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


def load(path: str, mass: float) -> float:
    """Write a link of `mass`, kg, load it, and return the mass that acts."""
    with open(path, "w") as file:
        file.write(LINK.format(mass=mass))
    return pybullet.getDynamicsInfo(pybullet.loadURDF(path), -1)[0]


print("pybullet", version("pybullet"))
pybullet.connect(pybullet.DIRECT)
same = [load("tool.urdf", mass) for mass in (1, 2, 3)]
others = [load(f"tool{mass}.urdf", mass) for mass in (1, 2, 3)]
pybullet.setPhysicsEngineParameter(enableFileCaching=0)
uncached = [load("tool.urdf", mass) for mass in (1, 2, 3)]
print(f"written 1, 2, 3 kg: one file name {same}, three names {others}, cache off {uncached}")
assert same == [1, 1, 1]
assert others == uncached == [1, 2, 3]
PYTHON
