"""A scene of your own, as MJCF text: what is known, what is missing, and the finished twin."""

import palpate as pp

SCENE = """<mujoco model="kitchen"><worldbody>
  <site name="robot_base"/>
  <body name="table" pos="0.5 0 -0.02"><geom type="box" size=".4 .5 .02" friction=".6 .005 .0001"/></body>
  <body name="tin" pos="0.5 0.1 0.05"><freejoint/>
    <geom type="cylinder" size=".033 .05" mass="?" friction=".6 .005 .0001"/></body>
</worldbody></mujoco>"""

scene = pp.load(SCENE)
print(scene)
print("missing:", *scene.missing)

run = scene.plan().run(noise="none", seed=1)
for line in run.twin.xml.splitlines():
    if "tin" in line or "mass" in line:
        print(line.strip())
