#!/usr/bin/env bash
# MuJoCo's identification toolbox does not apply a frozen parameter at all.
#
# Packages: mujoco==4.0.0 numpy==2.4.6 scipy==1.17.1 absl-py==2.5.1 colorama==0.4.6 tabulate==0.10.0 pyyaml==6.0.4.
# Expected: A frozen parameter is held at its value: it is written into the model and the optimiser leaves it alone.
# Happens: The model keeps the value of its XML file: the modifier of a frozen parameter is never called. A door
# whose friction is frozen at the true value is identified with a damping 65 % too high; with the same friction in
# the file, the damping is right.
# Why it matters: One freezes what has been measured before (mass, friction) to identify the rest. The rest then
# absorbs the error of the file, the fit converges, and nothing warns.
# Source: mujoco/sysid/_src/model_modifier.py, apply_param_modifiers_spec: only parameters that are not frozen are
# applied.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 numpy==2.4.6 scipy==1.17.1 absl-py==2.5.1 colorama==0.4.6 \
  tabulate==0.10.0 pyyaml==6.0.4
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import contextlib
import io
import logging
from importlib.metadata import version

import mujoco
import numpy as np
from mujoco import sysid

logging.disable(logging.CRITICAL)
DOOR = """<mujoco><option timestep=".002"/><worldbody><body>
<joint name="hinge" axis="0 0 1" damping="{damping}" frictionloss="{friction}"/>
<geom type="box" size=".3 .02 .5" pos=".3 0 0" mass="5"/></body></worldbody>
<actuator><motor joint="hinge"/></actuator><sensor><jointpos name="angle" joint="hinge"/></sensor></mujoco>"""
DAMPING, FRICTION = 0.8, 0.6


def record() -> tuple[np.ndarray, sysid.TimeSeries, sysid.TimeSeries]:
    """Return initial state, torque and angle of the true door."""
    model = mujoco.MjModel.from_xml_string(DOOR.format(damping=DAMPING, friction=FRICTION))
    data = mujoco.MjData(model)
    times = 0.002 * np.arange(2000)
    torque = 4 * np.sin(2 * np.pi * 0.5 * times)
    initial = sysid.create_initial_state(model, data.qpos, data.qvel, data.act)
    angles = []
    for value in torque:
        data.ctrl[0] = value
        mujoco.mj_step(model, data)
        angles.append(data.qpos.copy())
    measured = sysid.TimeSeries.from_names(times, np.array(angles), model, ["angle"])
    control = sysid.TimeSeries(times, torque[:, None])
    return initial, control, measured


RECORDING = record()


def identify(friction_in_file: float, frozen: float | None) -> tuple[float, float]:
    """Return the damping that fits best, and the friction of the model that was fitted."""
    spec = mujoco.MjSpec.from_string(DOOR.format(damping=0.3, friction=friction_in_file))
    initial, control, measured = RECORDING
    sequence = sysid.ModelSequences("door", spec, "swing", initial, control, measured)

    def write_damping(s: mujoco.MjSpec, p: sysid.Parameter) -> None:
        s.joint("hinge").damping[0] = p.value[0]

    def write_friction(s: mujoco.MjSpec, p: sysid.Parameter) -> None:
        s.joint("hinge").frictionloss = p.value[0]

    params = sysid.ParameterDict()
    params.add(sysid.Parameter("damping", 0.3, 0.01, 5, modifier=write_damping))
    if frozen is not None:
        params.add(sysid.Parameter("friction", frozen, 0, 2, frozen=True, modifier=write_friction))
    residual = sysid.build_residual_fn(models_sequences=[sequence], n_threads=1)
    with contextlib.redirect_stdout(io.StringIO()):  # the log of the iterations
        fit, _ = sysid.optimize(params, residual, verbose=False, optimizer="scipy")
    return fit["damping"].value[0], sysid.apply_param_modifiers(fit, spec).dof_frictionloss[0]


print("mujoco", version("mujoco"))
fits = {}
for name, in_file, frozen in (
    ("in the file", FRICTION, None),
    ("frozen at its true value, 0 in the file", 0.0, FRICTION),
    ("left at 0", 0.0, None),
):
    fits[name], friction = identify(in_file, frozen)
    print(
        f"friction {name}: damping {fits[name]:.3f} (true {DAMPING}), model's friction {friction}"
    )
right, frozen, absent = fits.values()
assert abs(right - DAMPING) < 0.02
assert frozen == absent
assert frozen > DAMPING + 0.1
PYTHON
