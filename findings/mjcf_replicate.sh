#!/usr/bin/env bash
# newton and pinocchio leave out what stands in `<replicate>` of an MJCF file: a body without mass, and without a word.
#
# Packages: newton==1.8.0 warp-lang==1.19.0 pin==4.1.0 mujoco==4.0.0 numpy==2.4.6.
# Expected: a reader that does not know an element says so, or refuses the file.
# Happens: three blocks of 1 kg, written as one block in `<replicate count="3">`, weigh 3 kg in MuJoCo. newton and
# pinocchio read the body and none of its blocks: 0 kg, no shape, no warning. (Drake leaves them out as well.)
# Why it matters: racks, bolts, rings and bowls are written in this way. A body without mass and shape does not fall,
# collide or load an arm; nothing says why. A file that MuJoCo wrote after compiling has the copies instead.
# Source: XML reference of MuJoCo, `replicate`; seen in these versions.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet newton==1.8.0 warp-lang==1.19.0 pin==4.1.0 mujoco==4.0.0 numpy==2.4.6
cd "$folder"
export WARP_CACHE_PATH="$folder/kernels"
"$folder/venv/bin/python" - <<'PYTHON'
import contextlib
import io
import warnings
from importlib.metadata import version
from pathlib import Path

import mujoco
import newton
import pinocchio as pin
import warp as wp

SCENE = """<mujoco><worldbody><body name="rack" pos="0 0 1"><freejoint/>
<replicate count="3" offset=".1 0 0"><geom type="box" size=".05 .03 .02" mass="1"/></replicate>
</body></worldbody></mujoco>"""
Path("rack.xml").write_text(SCENE)
wp.config.quiet = True
print(*(f"{name} {version(name)}" for name in ("mujoco", "newton", "pin")))

model = mujoco.MjModel.from_xml_path("rack.xml")
print(f"mujoco: {model.body_mass[1]:g} kg, {model.ngeom} shapes")
builder, said = newton.ModelBuilder(), io.StringIO()
with warnings.catch_warnings(record=True) as raised, contextlib.redirect_stdout(said):
    warnings.simplefilter("always")
    builder.add_mjcf("rack.xml")
print(f"newton: {builder.body_mass[0]:g} kg, {builder.shape_count} shapes, {len(raised)} warnings")
with warnings.catch_warnings(record=True) as raised_by_pinocchio:
    warnings.simplefilter("always")
    mass = pin.buildModelFromMJCF("rack.xml").inertias[1].mass
print(f"pinocchio: {mass:g} kg, {len(raised_by_pinocchio)} warnings")
assert model.body_mass[1] == 3 and model.ngeom == 3
assert builder.body_mass[0] == 0 and builder.shape_count == 0 and not raised and "replicate" not in said.getvalue()
assert mass == 0 and not raised_by_pinocchio
PYTHON
# Output, 2026-11-28:
# mujoco 4.0.0 newton 1.8.0 pin 4.1.0
# mujoco: 3 kg, 3 shapes
# newton: 0 kg, 0 shapes, 0 warnings
# pinocchio: 0 kg, 0 warnings
