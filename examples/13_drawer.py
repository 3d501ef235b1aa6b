"""A drawer: how it rubs, what damps it, and the finished joint."""

import palpate as pp

SCENE = """<mujoco model="kitchen"><worldbody>
  <body name="cabinet" pos="0.8 0 0">
    <geom type="box" size=".12 .01 .14" pos="0 .19 .14"/>
    <geom type="box" size=".12 .01 .14" pos="0 -.19 .14"/>
    <body name="drawer" pos="-.12 0 .16">
      <joint type="slide" axis="-1 0 0" range="0 .2" damping="?" frictionloss="?"/>
      <geom type="box" size=".01 .17 .1" mass="1.5"/>
      <geom name="knob" type="box" size=".012 .014 .02" pos="-.06 0 .06" mass=".1"/>
    </body></body>
</worldbody></mujoco>"""

run = pp.run(
    SCENE, "How large are the friction and the damping of the drawer?", noise="lab", seed=1
)
print(run["drawer.frictionloss"])
print(run["drawer.damping"])
print(next(line.strip() for line in run.twin.xml.splitlines() if "<joint" in line))
