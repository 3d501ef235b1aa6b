#!/usr/bin/env bash
# Every friction of a MuJoCo scene becomes 1 on the way through USD and back into MuJoCo.
#
# Packages: mujoco-usd-converter==0.2.0 writes the USD; mujoco-usd==4.0.0 with mujoco==4.0.0 reads it. Python 3.11 or
# 3.12 on Linux: usd-exchange, of the converter, has no other wheels.
# Expected: Both tools know UsdPhysics materials, so frictions 0.3 and 0.8 come back.
# Happens: The converter binds materials for the purpose "physics" (`material:binding:physics`). MuJoCo's reader looks
# at `material:binding` and gives all geoms friction 1. A second binding without purpose mends it. The file also
# switches `multiccd` off: the source has it on.
# Why it matters: USD is the way to Isaac and back. Measured friction is in the file, and a simulator of the same
# family does not use it. Nothing warns.
# Source: UsdPhysics, schema of PhysicsMaterialAPI: a material may be bound for the purpose physics, which is preferred
# to one without purpose. In the written file: the relation `material:binding:physics`.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv writer
writer/bin/pip install --quiet mujoco-usd-converter==0.2.0 mujoco==4.0.0 numpy==2.4.6
python3 -m venv reader
reader/bin/pip install --quiet mujoco-usd==4.0.0 mujoco==4.0.0 numpy==2.4.6
cat >scene.xml <<'MJCF'
<mujoco model="scene"><worldbody><geom name="table" type="box" size="1 1 .1" pos="0 0 -.1" friction=".8"/>
<body name="mug" pos="0 0 .05"><freejoint/><geom name="mug" type="box" size=".05 .05 .05" friction=".3"/></body>
</worldbody></mujoco>
MJCF
writer/bin/python - >writer.log 2>&1 <<'PYTHON' || (cat writer.log && exit 1)
import mujoco_usd_converter
from pxr import Usd, UsdShade

converter = mujoco_usd_converter.Converter(layer_structure=False)
stage = Usd.Stage.Open(converter.convert("scene.xml", "written").path)
stage.Export("converted.usdc")
for prim in stage.Traverse():
    binding = UsdShade.MaterialBindingAPI(prim).GetDirectBindingRel("physics")
    if binding.GetTargets():
        prim.CreateRelationship("material:binding", False).SetTargets(binding.GetTargets())
stage.Export("bound_twice.usdc")
PYTHON
reader/bin/python - <<'PYTHON'
from importlib.metadata import version

import mujoco

print(
    "mujoco", version("mujoco"), "mujoco-usd", version("mujoco-usd"), "mujoco-usd-converter 0.2.0"
)
MULTICCD = int(mujoco.mjtDisableBit.mjDSBL_MULTICCD)
frictions, multiccd = {}, {}
for path in ("scene.xml", "converted.usdc", "bound_twice.usdc"):
    model = mujoco.MjSpec.from_file(path).compile()
    frictions[path] = sorted(round(float(f), 6) for f in model.geom_friction[:, 0])
    multiccd[path] = not model.opt.disableflags & MULTICCD
    print(f"{path}: frictions {frictions[path]}, multiccd {multiccd[path]}")
assert frictions["scene.xml"] == frictions["bound_twice.usdc"] == [0.3, 0.8]
assert frictions["converted.usdc"] == [1.0, 1.0]
assert multiccd["scene.xml"]
assert not multiccd["converted.usdc"]
PYTHON
