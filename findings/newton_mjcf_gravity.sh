#!/usr/bin/env bash
# Newton reads a MuJoCo scene of the Moon with the gravity of the Earth.
#
# Packages: newton==1.8.0 warp-lang==1.19.0 numpy==2.4.6.
# Expected: With `parse_mujoco_options=True`, the default, the options of the file hold: gravity first of all.
# Happens: The builder's gravity stays at -9.81 m/s2 for `<option gravity="0 0 -1.62"/>` and for a tilted one. The
# flag that switches gravity off is obeyed.
# Why it matters: Tilted gravity is the usual way to write a slope or a wall-mounted arm in MJCF. Weight, friction
# tests and gravity compensation are then wrong without a message.
# Source: newton/_src/utils/import_mjcf.py: of the option element, the gravity flag is evaluated and the solver
# options; the gravity vector is not read. import_usd.py does read it.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet newton==1.8.0 warp-lang==1.19.0 numpy==2.4.6
cd "$folder"
export WARP_CACHE_PATH="$folder/kernels"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import warp as wp

wp.config.quiet = True
import newton  # noqa: E402

SCENE = """<mujoco model="scene"><option gravity="{gravity}"><flag gravity="{flag}"/></option>
<worldbody><body pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .1" mass="2"/></body></worldbody></mujoco>"""


def read(gravity: str, flag: str = "enable") -> list[float]:
    """Return the gravity of the model that newton builds, m/s2."""
    builder = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    builder.add_mjcf(SCENE.format(gravity=gravity, flag=flag), parse_mujoco_options=True)
    return [round(float(x), 3) + 0.0 for x in builder.gravity]


print("newton", version("newton"))
for gravity in ("0 0 -1.62", "4.9 0 -8.5"):
    print(f"gravity {gravity}: newton {read(gravity)}")
    assert read(gravity) == [0, 0, -9.81]
print(f"flag gravity disable: newton {read('0 0 -1.62', 'disable')}")
assert read("0 0 -1.62", "disable") == [0, 0, 0]
PYTHON
