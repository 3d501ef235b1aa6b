#!/usr/bin/env bash
# In Newton the twelfth of twelve boxes that stand on a floor falls through it.
#
# Packages: newton==1.8.0 warp-lang==1.19.0 mujoco==4.0.0 mujoco-warp==4.0.0 numpy==2.4.6.
# Expected: SolverMuJoCo makes room for the contacts of its model: four a box, known from the model at once.
# Happens: With the arguments nconmax and njmax left out, the room follows the contacts of the first moment. Boxes that
# are dropped from 10 cm share the room of an empty scene: four are caught, all others fall through the floor. Of
# twelve boxes that stand on it, one still falls. The simulation goes on; a line is printed for each kind of overflow.
# With room for all contacts every box stands.
# Why it matters: A table with six objects is an ordinary scene. An object that is gone looks like an error of the model.
# Source: mujoco_warp `put_data` estimates nconmax and njmax from the data that it is given; Newton passes no other
# value on.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet newton==1.8.0 warp-lang==1.19.0 mujoco==4.0.0 mujoco-warp==4.0.0 numpy==2.4.6
cd "$folder"
export WARP_CACHE_PATH="$folder/kernels"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import warp as wp

wp.config.quiet = True
import newton  # noqa: E402

BOX = '<body pos="{x} 0 {z}"><freejoint/><geom type="box" size=".05 .05 .05"/></body>'
SCENE = '<mujoco model="scene"><worldbody><geom type="plane" size="9 9 .1"/>{boxes}</worldbody></mujoco>'
STEP, SECONDS = 0.002, 1.0


def fallen(count: int, z: float, **room: int) -> int:
    """Return how many of `count` boxes, with their centres at `z` m, are below the floor after a second."""
    boxes = "".join(BOX.format(x=0.2 * i, z=z) for i in range(count))
    builder = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    builder.add_mjcf(SCENE.format(boxes=boxes))
    model = builder.finalize(device="cpu")
    solver = newton.solvers.SolverMuJoCo(model, **room)
    now, then, control = model.state(), model.state(), model.control()
    newton.eval_fk(model, model.joint_q, model.joint_qd, now)
    for _ in range(round(SECONDS / STEP)):
        solver.step(now, then, control, None, STEP)
        now, then = then, now
    return int(np.count_nonzero(now.body_q.numpy()[:, 2] < 0.0))


found = {
    "4 dropped": fallen(4, 0.15),
    "12 dropped": fallen(12, 0.15),
    "12 standing": fallen(12, 0.0499),
    "12 dropped, with room": fallen(12, 0.15, nconmax=200, njmax=1000),
}
print("newton", version("newton"), "mujoco_warp", version("mujoco-warp"))
for case, count in found.items():
    print(f"{case}: {count} fell through the floor")
assert found == {"4 dropped": 0, "12 dropped": 8, "12 standing": 1, "12 dropped, with room": 0}
PYTHON
