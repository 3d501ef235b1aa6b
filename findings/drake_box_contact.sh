#!/usr/bin/env bash
# A small block does not rest on a table in Drake: two boxes touch in one point, and the block wanders and tips.
#
# Packages: drake==1.51.1 numpy==2.4.6.
# Expected: A block of 0.1 kg that stands on a table stays there.
# Happens: By default two shapes have one point contact, which jumps between the corners. The block leaves its place by
# centimetres within a second. With `compliance_type = "compliant"` for all shapes (hydroelastic contact) it stays.
# Why it matters: Objects of a twin drift at rest, and friction, tilt and stiffness look wrong. No warning is given.
# Source: Drake, "Contact Modeling": the point contact model computes a single point pair for two penetrating shapes.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet drake==1.51.1 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from pydrake.geometry import SceneGraphConfig
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

SCENE = """<mujoco model="scene"><worldbody><geom name="table" type="box" size=".3 .5 .02" pos="0 0 -.02" friction="1"/>
<body name="block" pos="0 0 .02" euler="0 0 25"><freejoint/><geom type="box" size=".03 .03 .02" mass=".1" friction="1"/>
</body></worldbody></mujoco>"""


def moved(compliant: bool) -> float:
    """Distance, m, that the block moves from its place within a second."""
    builder = DiagramBuilder()
    plant, graph = AddMultibodyPlantSceneGraph(builder, time_step=0.002)
    if compliant:
        config = SceneGraphConfig()
        config.default_proximity_properties.compliance_type = "compliant"
        graph.set_config(config)
    Parser(plant).AddModelsFromString(SCENE, "mujoco.xml")
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyContextFromRoot(simulator.get_context())
    block = plant.GetBodyByName("block")
    before = block.EvalPoseInWorld(context).translation().copy()
    simulator.AdvanceTo(1.0)
    return float(np.linalg.norm(block.EvalPoseInWorld(context).translation() - before))


point, compliant = moved(compliant=False), moved(compliant=True)
print("drake", version("drake"))
print(f"point contact: moves {1e3 * point:.2f} mm in 1 s; compliant: {1e3 * compliant:.2f} mm")
assert point > 0.01
assert compliant < 0.002
PYTHON
