#!/usr/bin/env bash
# A `<pair>` that names only two geoms of friction 0.05 gives them friction 1.
#
# Packages: mujoco==4.0.0 numpy==2.4.6.
# Expected: A contact pair that states no friction takes it from its geoms, as every other contact does: the line
# only says that they collide.
# Happens: The pair gets the default of pairs: friction 1, condim 3, the default solref. A box of friction 0.05
# stands on a slope of 11.5 degrees and slides without the line. A change of `geom_friction` at run time has no
# effect either.
# Why it matters: Grippers list pairs for pads and objects. Then the friction that was measured and written into the
# geoms, and domain randomisation of `geom_friction`, act on nothing.
# Source: MuJoCo's XML reference, contact/pair: a pair has its properties from its own attributes and defaults, and
# those of the geoms are not used.
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

SCENE = """<mujoco><option gravity="2 0 -9.81"/><worldbody>
<geom name="table" type="plane" size="9 9 .1" friction="{friction}"/>
<body pos="0 0 .05"><freejoint/><geom name="box" type="box" size=".05 .05 .05" friction="{friction}"/></body>
</worldbody><contact>{pair}</contact></mujoco>"""
PAIR = '<pair geom1="table" geom2="box"/>'


def slide(pair: str, written: float, later: float) -> tuple[float, float]:
    """Return the way of the box in 1 s on the slope, m, and the friction that acts."""
    model = mujoco.MjModel.from_xml_string(SCENE.format(pair=pair, friction=written))
    model.geom_friction[:, 0] = later
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    friction = data.contact[0].friction[0]
    for _ in range(499):
        mujoco.mj_step(model, data)
    return data.qpos[0], friction


print("mujoco", version("mujoco"))
for written, later in ((0.05, 0.05), (1.0, 0.05)):
    free, paired = slide("", written, later), slide(PAIR, written, later)
    print(f"geoms have {written} in the file, {later} at run time:")
    print(f"  without <pair>: friction {free[1]}, way {free[0]:.3f} m")
    print(f"  with <pair>:    friction {paired[1]}, way {paired[0]:.3f} m")
    assert free[1] == 0.05
    assert free[0] > 0.5
    assert paired[1] == 1.0
    assert paired[0] < 0.01
PYTHON
