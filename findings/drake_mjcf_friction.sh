#!/usr/bin/env bash
# Drake combines the friction of an MJCF pair by the harmonic mean and ignores `priority`.
#
# Packages: drake==1.51.1 mujoco==4.0.0 numpy==2.4.6.
# Expected: The geom with the higher priority decides (0.3), or MuJoCo's rule for equal priority holds: the larger
# value (0.8).
# Happens: A ball of friction 0.3 with priority 1 slides on a table of 0.8 with 0.436. Drake warns of unsupported
# joint attributes, but not of priority.
# Why it matters: The friction that was measured for one object on one table, written as MuJoCo's priority, acts 45
# % stronger in Drake. A robot pushes with a force that is too large, without a message.
# Source: Drake's documentation of CoulombFriction: the coefficients of two surfaces combine as 2 a b / (a + b).
# MuJoCo's XML reference, geom/priority.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet drake==1.51.1 mujoco==4.0.0 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import mujoco
import numpy as np
from pydrake.all import AddMultibodyPlantSceneGraph, DiagramBuilder, Parser, Simulator

SCENE = """<mujoco model="scene"><worldbody>
<geom name="table" type="box" size="2 2 .1" pos="0 0 -.1" friction="{table}"/>
<body name="ball" pos="0 0 .05"><freejoint/>
<geom name="ball" type="sphere" size=".05" mass=".25" friction="{ball}" {extra}/></body>
</worldbody></mujoco>"""


def drake_friction(scene: str) -> float:
    """Return tangential over normal force of the sliding ball in Drake."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    Parser(plant).AddModelsFromString(scene, "xml")
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(0.2)
    plant.SetVelocities(plant_context, np.array([0, 0, 0, 2.0, 0, 0]))
    simulator.AdvanceTo(0.25)
    contacts = plant.get_contact_results_output_port().Eval(plant_context)
    force = contacts.point_pair_contact_info(0).contact_force()
    return np.hypot(*force[:2]) / abs(force[2])


def mujoco_friction(scene: str) -> float:
    """Return the friction coefficient that acts in MuJoCo."""
    model = mujoco.MjModel.from_xml_string(scene)
    data = mujoco.MjData(model)
    for _ in range(10):
        mujoco.mj_step(model, data)
    return float(data.contact[0].friction[0])


print("drake", version("drake"), "mujoco", version("mujoco"))
for extra, ours in (('priority="1"', 0.3), ("", 0.8)):
    scene = SCENE.format(ball=0.3, table=0.8, extra=extra)
    theirs = drake_friction(scene)
    print(f"ball 0.3 {extra}, table 0.8: mujoco {mujoco_friction(scene)}, drake {theirs:.3f}")
    assert mujoco_friction(scene) == ours
    assert abs(theirs - 2 * 0.3 * 0.8 / (0.3 + 0.8)) < 2e-3
PYTHON
